//! The host's side of the border: a table becomes a [`Skill`] again.

use std::ffi::c_void;
use std::sync::Arc;

use serde::de::DeserializeOwned;

use crate::abi::{ABI, Bytes, FEATURES, Header, HostTable, LogLevel, MAGIC, OpaquePlan, SkillTable, View};
use crate::plugin::faulted;
use crate::{Execution, Failure, FailureCode, Manifest, ManifestError, Plan, PlanRequest, PlanSummary, Skill, StepInput, StepReply};

/// Where the lines go that plugins log.
pub type LogSink = Arc<dyn Fn(LogLevel, &str) + Send + Sync>;

/// A skill behind the C table: used like any other [`Skill`].
#[derive(Clone)]
pub struct Plugin {
    table: &'static SkillTable,
    log: LogSink,
}

/// Why a table cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AbiError {
    /// The entry answered nothing.
    #[error("its entry function answered no table")]
    NoTable,
    /// The table is something else.
    #[error("its table does not begin with the mark of a skill; is this the library that skill.yaml means?")]
    Magic,
    /// Built against another version of the border.
    #[error("it was built for version {found} of the plugin border, and this program speaks version {ABI}; rebuild the skill")]
    Version {
        /// The plugin's version.
        found: u32,
    },
    /// Shorter than this version's table.
    #[error("its table has {found} bytes where {} are needed; rebuild the skill", size_of::<SkillTable>())]
    Size {
        /// The plugin's size.
        found: u32,
    },
    /// Needs something of the host that it does not offer.
    #[error("it needs features of a newer program (bits {unknown:#x})")]
    Features {
        /// The unknown bits.
        unknown: u64,
    },
}

impl Plugin {
    /// A skill that is linked into this very program.
    pub fn in_process(table: &'static SkillTable, log: LogSink) -> Result<Self, AbiError> {
        check(table.header)?;
        Ok(Self { table, log })
    }

    /// A table that a loaded library answered.
    ///
    /// # Safety
    /// `table` is null, or points to a [`Header`] and, if that names this version, to a whole [`SkillTable`] whose functions
    /// keep the contract of [`crate::abi`]; it stays valid until the program ends (the library is never unloaded).
    pub unsafe fn from_raw(table: *const SkillTable, log: LogSink) -> Result<Self, AbiError> {
        if table.is_null() {
            return Err(AbiError::NoTable);
        }
        // SAFETY: every version's table begins with a `Header`.
        check(unsafe { table.cast::<Header>().read() })?;
        // SAFETY: the header says that it is a whole table of this version, and the caller vouches for its contents.
        Ok(Self { table: unsafe { &*table }, log })
    }

    /// Calls `body` with a host table that is valid until it returns.
    fn with_host<T>(&self, cancelled: &(dyn Fn() -> bool + Sync), body: impl FnOnce(&HostTable) -> T) -> T {
        let context = Context { cancelled, log: &self.log };
        let host = HostTable {
            header: Header { magic: MAGIC, abi: ABI, size: size_of::<HostTable>() as u32, features: 0 },
            context: (&raw const context).cast(),
            cancelled: host_cancelled,
            log: host_log,
        };
        body(&host)
    }

    /// Reads an answer and gives its memory back.
    fn take<T: DeserializeOwned>(&self, bytes: Bytes, stage: &str) -> Result<T, Failure> {
        // SAFETY: the plugin made these bytes and lends them until they are given back below.
        let reply = rmp_serde::from_slice(unsafe { View { data: bytes.data, len: bytes.len }.bytes() });
        // SAFETY: the bytes came from this table's own functions and are not used again; `reply` owns what it read.
        unsafe { (self.table.free_bytes)(bytes) };
        reply.map_err(|e| fault(stage, format!("the plugin's answer cannot be read: {e}")))
    }
}

fn check(header: Header) -> Result<(), AbiError> {
    if header.magic != MAGIC {
        return Err(AbiError::Magic);
    }
    if header.abi != ABI {
        return Err(AbiError::Version { found: header.abi });
    }
    if (header.size as usize) < size_of::<SkillTable>() {
        return Err(AbiError::Size { found: header.size });
    }
    match header.features & !FEATURES {
        0 => Ok(()),
        unknown => Err(AbiError::Features { unknown }),
    }
}

fn fault(stage: &str, message: String) -> Failure {
    Failure { code: FailureCode::PluginFault, stage: stage.to_owned(), message }
}

/// What [`HostTable::context`] points to.
struct Context<'a> {
    cancelled: &'a (dyn Fn() -> bool + Sync),
    log: &'a LogSink,
}

unsafe extern "C" fn host_cancelled(context: *const c_void) -> u32 {
    // SAFETY: the plugin hands back the context of the call that is running, made in `with_host`.
    let context = unsafe { &*context.cast::<Context<'_>>() };
    u32::from((context.cancelled)())
}

unsafe extern "C" fn host_log(context: *const c_void, level: u32, text: View) {
    // SAFETY: as above; the text is lent for the length of this call.
    let (context, text) = unsafe { (&*context.cast::<Context<'_>>(), text.bytes()) };
    (context.log)(LogLevel::from_code(level), &String::from_utf8_lossy(text));
}

impl Skill for Plugin {
    fn manifest(&self) -> Result<Manifest, ManifestError> {
        // SAFETY: the host table is valid for the call.
        let bytes = self.with_host(&|| false, |host| unsafe { (self.table.manifest)(host) });
        let reply: Result<Manifest, Failure> = self.take(bytes, "manifest").and_then(|r| r);
        reply.map_err(|f| ManifestError::Malformed { line: None, message: f.message })
    }

    fn plan(&self, request: &PlanRequest, cancelled: &(dyn Fn() -> bool + Sync)) -> Result<Plan, Failure> {
        let request = rmp_serde::to_vec_named(request).map_err(|e| fault("plan", format!("the request cannot be sent: {e}")))?;
        let mut plan: *mut OpaquePlan = std::ptr::null_mut();
        // SAFETY: the host table, the request and the place for the plan's address are valid for the call.
        let bytes = self.with_host(cancelled, |host| unsafe { (self.table.plan)(host, View::of(&request), &raw mut plan) });
        let execution = PluginExecution { plugin: self.clone(), plan };
        let summary: PlanSummary = self.take::<Result<PlanSummary, Failure>>(bytes, "plan").and_then(|r| r)?;
        if plan.is_null() {
            return Err(fault("plan", "the plugin answered a plan's summary and no plan".to_owned()));
        }
        Ok(Plan { summary, execution: Box::new(execution) })
    }
}

/// A plan that lives in a plugin; dropped there when this is.
struct PluginExecution {
    plugin: Plugin,
    plan: *mut OpaquePlan,
}

// SAFETY: a plan may be stepped from any thread, though not from two at once, and `&mut self` sees to that.
unsafe impl Send for PluginExecution {}

impl Execution for PluginExecution {
    fn step(&mut self, input: &StepInput) -> StepReply {
        let input = match rmp_serde::to_vec_named(input) {
            Ok(input) => input,
            Err(e) => return faulted(fault("step", format!("the input cannot be sent: {e}"))),
        };
        // SAFETY: the host table and input are valid for the call, and the plan lives until `drop`.
        let bytes = self.plugin.with_host(&|| false, |host| unsafe { (self.plugin.table.step)(host, self.plan, View::of(&input)) });
        self.plugin.take(bytes, "step").unwrap_or_else(faulted)
    }

    fn cancel(&mut self) {
        // SAFETY: the plan lives until `drop`.
        unsafe { (self.plugin.table.cancel)(self.plan) };
    }
}

impl Drop for PluginExecution {
    fn drop(&mut self) {
        if !self.plan.is_null() {
            // SAFETY: the plan came from this plugin, and nothing uses it after this.
            unsafe { (self.plugin.table.release_plan)(self.plan) };
        }
    }
}
