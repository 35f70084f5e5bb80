//! The plugin border: C tables of functions, and bytes. No Rust type crosses it, so host and plugin may come from
//! different compilers.
//!
//! A plugin exports one function of type [`Entry`], named in its `skill.yaml`; it answers a [`SkillTable`] that lives as
//! long as the library. Each call that can run the skill's code is given a [`HostTable`], valid for that call alone. What is
//! said travels as MessagePack with field names ([`crate::Manifest`], [`crate::PlanRequest`], ...). Memory is freed by the
//! side that made it. A panic never crosses: the plugin catches it and answers [`crate::FailureCode::PluginFault`].

use std::ffi::c_void;

/// First eight bytes of both tables.
pub const MAGIC: u64 = u64::from_le_bytes(*b"SAGCISKL");

/// Version of the border. It grows when a table or the meaning of a message changes so that older plugins would break;
/// new fields with defaults, and functions added at the end of a table, do not need a new version.
pub const ABI: u32 = 1;

/// The skill may answer [`crate::Status::Look`].
pub const FEATURE_LOOK: u64 = 1;

/// All features that this version of the border knows. A host refuses a plugin that needs one it does not know.
pub const FEATURES: u64 = FEATURE_LOOK;

/// The first fields of both tables, the same in every version, so that any host can read them before it trusts the rest.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// [`MAGIC`].
    pub magic: u64,
    /// [`ABI`].
    pub abi: u32,
    /// Size of the whole table in bytes.
    pub size: u32,
    /// Features that are needed of the other side.
    pub features: u64,
}

/// Bytes lent for the length of a call.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct View {
    pub(crate) data: *const u8,
    pub(crate) len: usize,
}

impl View {
    pub(crate) fn of(bytes: &[u8]) -> Self {
        Self { data: bytes.as_ptr(), len: bytes.len() }
    }

    /// # Safety
    /// `data` points to `len` bytes that stay valid and unchanged for `'a`, or is null.
    pub(crate) unsafe fn bytes<'a>(self) -> &'a [u8] {
        if self.data.is_null() || self.len == 0 {
            return &[];
        }
        // SAFETY: not null, and the caller vouches for the rest.
        unsafe { std::slice::from_raw_parts(self.data, self.len) }
    }
}

/// Bytes made by the plugin; the host gives them back to [`SkillTable`]'s `free_bytes`.
#[repr(C)]
#[derive(Debug)]
pub struct Bytes {
    pub(crate) data: *mut u8,
    pub(crate) len: usize,
    pub(crate) capacity: usize,
}

impl Bytes {
    pub(crate) const EMPTY: Self = Self { data: std::ptr::null_mut(), len: 0, capacity: 0 };

    pub(crate) fn from_vec(bytes: Vec<u8>) -> Self {
        let mut bytes = std::mem::ManuallyDrop::new(bytes);
        Self { data: bytes.as_mut_ptr(), len: bytes.len(), capacity: bytes.capacity() }
    }

    /// # Safety
    /// The value came from [`Self::from_vec`] of this very library, and is not used again.
    pub(crate) unsafe fn into_vec(self) -> Vec<u8> {
        if self.data.is_null() {
            return Vec::new();
        }
        // SAFETY: these are the three parts of a `Vec<u8>` of this library's allocator, taken apart in `from_vec`.
        unsafe { Vec::from_raw_parts(self.data, self.len, self.capacity) }
    }
}

/// A plan that lives inside the plugin; the host only holds its address.
#[repr(C)]
pub struct OpaquePlan {
    _private: [u8; 0],
}

/// What the host offers to a running call.
#[repr(C)]
pub struct HostTable {
    pub(crate) header: Header,
    /// Handed back to the functions below.
    pub(crate) context: *const c_void,
    /// Not zero once the host wants no plan any more. May be called from any thread during the call.
    pub(crate) cancelled: unsafe extern "C" fn(context: *const c_void) -> u32,
    /// Takes a line for the log: level and UTF-8 text. May be called from any thread during the call.
    pub(crate) log: unsafe extern "C" fn(context: *const c_void, level: u32, text: View),
}

/// What a plugin offers. Made only by [`SkillTable::of`], or read from a loaded library.
#[repr(C)]
pub struct SkillTable {
    pub(crate) header: Header,
    /// The skill's manifest: bytes of `Result<Manifest, Failure>`.
    pub(crate) manifest: unsafe extern "C" fn(host: *const HostTable) -> Bytes,
    /// Plans: bytes of a `PlanRequest` in, of `Result<PlanSummary, Failure>` out; `plan` is set if that is `Ok`, else null.
    pub(crate) plan: unsafe extern "C" fn(host: *const HostTable, request: View, plan: *mut *mut OpaquePlan) -> Bytes,
    /// One period: bytes of a `StepInput` in, of a `StepReply` out. Not to be called from two threads at once.
    pub(crate) step: unsafe extern "C" fn(host: *const HostTable, plan: *mut OpaquePlan, input: View) -> Bytes,
    /// From now on each step is told to stop. May be called from any thread while the plan lives.
    pub(crate) cancel: unsafe extern "C" fn(plan: *mut OpaquePlan),
    /// Ends the plan's life.
    pub(crate) release_plan: unsafe extern "C" fn(plan: *mut OpaquePlan),
    /// Frees bytes that this plugin made.
    pub(crate) free_bytes: unsafe extern "C" fn(bytes: Bytes),
}

/// The function that a plugin exports.
pub type Entry = unsafe extern "C" fn() -> *const SkillTable;

/// How much a line of the log matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LogLevel {
    /// Something is wrong, but the skill goes on.
    Warning,
    /// Something a person may want to know.
    Info,
    /// For the skill's author.
    Debug,
}

impl LogLevel {
    pub(crate) fn code(self) -> u32 {
        match self {
            Self::Warning => 0,
            Self::Info => 1,
            Self::Debug => 2,
        }
    }

    pub(crate) fn from_code(code: u32) -> Self {
        match code {
            0 => Self::Warning,
            1 => Self::Info,
            _ => Self::Debug,
        }
    }
}
