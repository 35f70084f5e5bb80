//! The plugin's side of the border: puts a [`Skill`] behind a [`SkillTable`].

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::Serialize;

use crate::abi::{ABI, Bytes, FEATURE_LOOK, Header, HostTable, LogLevel, MAGIC, OpaquePlan, SkillTable, View};
use crate::{Execution, Failure, FailureCode, PlanRequest, Skill, Status, StepInput, StepReply};

/// Exports a skill from its library: `export_skill!(Open, sagci_skill_open);`
///
/// The skill type must be [`Default`]; it is made anew for each call, so whatever lasts belongs into the plan. The entry's
/// name must be the skill's own: two skills that are linked into one program with one name between them would be one.
#[macro_export]
macro_rules! export_skill {
    ($skill:ty, $entry:ident) => {
        /// Entry of the plugin: the table of this skill's functions.
        // SAFETY (the attribute): the name is this skill's own and so stands once in any program.
        #[allow(unsafe_code)]
        #[unsafe(no_mangle)]
        pub extern "C" fn $entry() -> *const $crate::SkillTable {
            static TABLE: $crate::SkillTable = $crate::SkillTable::of::<$skill>();
            &TABLE
        }
    };
}

impl SkillTable {
    /// The table of a skill.
    pub const fn of<S: Skill + Default>() -> Self {
        Self {
            header: Header { magic: MAGIC, abi: ABI, size: size_of::<Self>() as u32, features: FEATURE_LOOK },
            manifest: manifest::<S>,
            plan: plan::<S>,
            step,
            cancel,
            release_plan,
            free_bytes,
        }
    }
}

/// Writes a line into the host's log, if a call from a host is running on this thread.
pub fn log(level: LogLevel, text: &str) {
    let host = HOST.get();
    if host.is_null() {
        return;
    }
    // SAFETY: `HOST` is set only by `Call`, for the length of a call, and the host keeps its table valid for that long.
    unsafe { ((*host).log)((*host).context, level.code(), View::of(text.as_bytes())) };
}

thread_local! {
    /// The host's table while one of its calls runs on this thread.
    static HOST: Cell<*const HostTable> = const { Cell::new(std::ptr::null()) };
}

/// Keeps `HOST` set while it lives. Calls may nest, when two skills are linked into one program.
struct Call {
    outer: *const HostTable,
}

impl Call {
    fn begin(host: *const HostTable) -> Self {
        Self { outer: HOST.replace(host) }
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        HOST.set(self.outer);
    }
}

/// The host's cancel flag. It may be read from any thread while the call lasts.
struct CancelToken(*const HostTable);

// SAFETY: the host promises that `cancelled` may be called from any thread during the call; nothing else is read.
unsafe impl Sync for CancelToken {}

impl CancelToken {
    fn read(&self) -> bool {
        // SAFETY: the table is valid for the length of the call, and this token does not outlive it.
        !self.0.is_null() && unsafe { ((*self.0).cancelled)((*self.0).context) } != 0
    }
}

/// What [`OpaquePlan`] stands for.
struct LivePlan {
    cancelled: AtomicBool,
    /// `None` after a panic: what it left behind cannot be trusted.
    execution: Mutex<Option<Box<dyn Execution>>>,
}

fn fault(stage: &str, message: String) -> Failure {
    Failure { code: FailureCode::PluginFault, stage: stage.to_owned(), message }
}

/// Runs the skill's code; a panic becomes a failure.
fn guarded<T>(stage: &str, host: *const HostTable, body: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
    let _call = Call::begin(host);
    catch_unwind(AssertUnwindSafe(body)).unwrap_or_else(|payload| {
        let message = panic_message(payload.as_ref());
        // The payload's own drop may panic once more, and nothing would catch that.
        std::mem::forget(payload);
        Err(fault(stage, format!("the skill panicked: {message}")))
    })
}

fn panic_message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(|s| (*s).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_else(|| "no message".to_owned())
}

fn encode<T: Serialize>(value: &T) -> Bytes {
    rmp_serde::to_vec_named(value).map_or(Bytes::EMPTY, Bytes::from_vec)
}

unsafe extern "C" fn manifest<S: Skill + Default>(host: *const HostTable) -> Bytes {
    let reply = guarded("manifest", host, || {
        S::default().manifest().map_err(|e| fault("manifest", format!("the manifest inside the library is wrong: {e}")))
    });
    encode(&reply)
}

unsafe extern "C" fn plan<S: Skill + Default>(host: *const HostTable, request: View, plan: *mut *mut OpaquePlan) -> Bytes {
    let token = CancelToken(host);
    let reply = guarded("plan", host, || {
        // SAFETY: the host lends the request for the length of this call.
        let request: PlanRequest = rmp_serde::from_slice(unsafe { request.bytes() })
            .map_err(|e| fault("plan", format!("the host's request cannot be read: {e}")))?;
        S::default().plan(&request, &|| token.read())
    });
    let (address, reply) = match reply {
        Ok(made) => {
            let live = LivePlan { cancelled: AtomicBool::new(false), execution: Mutex::new(Some(made.execution)) };
            (Box::into_raw(Box::new(live)).cast(), Ok(made.summary))
        }
        Err(failure) => (std::ptr::null_mut(), Err(failure)),
    };
    if !plan.is_null() {
        // SAFETY: the host gives a valid place to write the plan's address to.
        unsafe { *plan = address };
    }
    encode(&reply)
}

unsafe extern "C" fn step(host: *const HostTable, plan: *mut OpaquePlan, input: View) -> Bytes {
    // SAFETY: the address came from `plan` of this library and has not been released; only shared access is made from it.
    let Some(live) = (unsafe { plan.cast::<LivePlan>().as_ref() }) else {
        return encode(&faulted(fault("step", "there is no such plan".to_owned())));
    };
    let reply = guarded("step", host, || {
        // SAFETY: the host lends the input for the length of this call.
        let mut input: StepInput =
            rmp_serde::from_slice(unsafe { input.bytes() }).map_err(|e| fault("step", format!("the host's input cannot be read: {e}")))?;
        input.cancel |= live.cancelled.load(Ordering::Relaxed);
        let mut slot = live.execution.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        // Taken out while it runs: after a panic it is gone.
        let mut execution = slot.take().ok_or_else(|| fault("step", "the skill panicked before and cannot go on".to_owned()))?;
        let reply = execution.step(&input);
        *slot = Some(execution);
        Ok(reply)
    });
    encode(&reply.unwrap_or_else(faulted))
}

/// A reply without a usable command: the host brings the arm to rest by itself.
pub(crate) fn faulted(failure: Failure) -> StepReply {
    let status = Status::Failed { failure, measured: Vec::new(), changes: Vec::new() };
    StepReply { command: Default::default(), phase: 0, progress: 0.0, status }
}

unsafe extern "C" fn cancel(plan: *mut OpaquePlan) {
    // SAFETY: the address came from `plan` of this library and has not been released.
    if let Some(live) = unsafe { plan.cast::<LivePlan>().as_ref() } {
        live.cancelled.store(true, Ordering::Relaxed);
    }
}

unsafe extern "C" fn release_plan(plan: *mut OpaquePlan) {
    if plan.is_null() {
        return;
    }
    // SAFETY: the address came from `Box::into_raw` in `plan` of this library, and the host does not use it again.
    let live = unsafe { Box::from_raw(plan.cast::<LivePlan>()) };
    if let Err(payload) = catch_unwind(AssertUnwindSafe(|| drop(live))) {
        std::mem::forget(payload);
    }
}

unsafe extern "C" fn free_bytes(bytes: Bytes) {
    // SAFETY: the bytes came from `encode` of this library, and the host does not use them again.
    drop(unsafe { bytes.into_vec() });
}
