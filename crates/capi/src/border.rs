//! What each function of the border does with pointers, errors and panics.

use std::cell::RefCell;
use std::ffi::{CStr, CString, OsStr, c_char};
use std::mem::MaybeUninit;
use std::os::unix::ffi::OsStrExt as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use vps::Error;

/// How a call ended. Later versions may have more.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum vps_status {
    /// As asked.
    VPS_OK = 0,
    /// An argument is null, or a value that its parameter does not allow.
    VPS_ERROR_ARGUMENT = 1,
    /// A mesh file or arrays that are no mesh.
    VPS_ERROR_MESH = 2,
    /// More voxels than one map or the memory holds.
    VPS_ERROR_GRID = 3,
    /// A file of a baked part that cannot be read or written.
    VPS_ERROR_FILE = 4,
    /// The callback for progress ended the bake.
    VPS_ERROR_CANCELLED = 5,
    /// A mistake of this library; please report it.
    VPS_ERROR_INTERNAL = 6,
}

pub(crate) use vps_status::*;

/// Why a call failed.
pub(crate) struct Failure(vps_status, String);

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let status = match error {
            Error::Mesh { .. } | Error::Arrays { .. } => VPS_ERROR_MESH,
            Error::Grid { .. } => VPS_ERROR_GRID,
            Error::File { .. } => VPS_ERROR_FILE,
            Error::Cancelled => VPS_ERROR_CANCELLED,
            _ => VPS_ERROR_ARGUMENT,
        };
        Self(status, error.to_string())
    }
}

impl Failure {
    /// An argument that cannot be.
    pub(crate) fn argument(what: String) -> Self {
        Self(VPS_ERROR_ARGUMENT, what)
    }
}

fn refused(name: &str, what: &str) -> Failure {
    Failure::argument(format!("{name} {what}"))
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// Text of the last call of this thread that failed: what is wrong, where, and what to do, in
/// UTF-8; empty before. It stays until the next call of this thread that fails.
#[unsafe(no_mangle)]
pub extern "C" fn vps_last_error() -> *const c_char {
    LAST_ERROR.try_with(|text| text.borrow().as_ptr()).unwrap_or(c"the thread is ending".as_ptr())
}

/// Runs a call: no panic leaves it, and its error becomes that of the thread.
pub(crate) fn call(run: impl FnOnce() -> Result<(), Failure>) -> vps_status {
    // Unwind-safe: queries put their memory back or drop it, and what was being made is dropped.
    let failed = match catch_unwind(AssertUnwindSafe(run)) {
        Ok(Ok(())) => return VPS_OK,
        Ok(Err(failure)) => failure,
        Err(panic) => {
            let said = panic
                .downcast_ref::<String>()
                .map(String::as_str)
                .or(panic.downcast_ref::<&str>().copied());
            Failure(
                VPS_ERROR_INTERNAL,
                format!("a mistake in libvps, please report it: {}", said.unwrap_or("no text")),
            )
        }
    };
    let Failure(status, text) = failed;
    let text = CString::new(text.replace('\0', " ")).unwrap_or_default();
    let _ = LAST_ERROR.try_with(|last| last.replace(text));
    status
}

/// What an argument points at.
pub(crate) fn given<'a, T>(name: &str, pointer: Option<&'a T>) -> Result<&'a T, Failure> {
    pointer.ok_or_else(|| refused(name, "is null"))
}

/// What an argument points at, to be changed.
pub(crate) fn given_mut<'a, T>(
    name: &str,
    pointer: Option<&'a mut T>,
) -> Result<&'a mut T, Failure> {
    pointer.ok_or_else(|| refused(name, "is null"))
}

/// The place that an argument names for a result.
pub(crate) fn place<'a, T>(
    name: &str,
    pointer: Option<&'a mut MaybeUninit<T>>,
) -> Result<&'a mut MaybeUninit<T>, Failure> {
    pointer.ok_or_else(|| refused(name, "is null"))
}

/// Runs a call that makes a handle: null where it fails.
pub(crate) fn make<T>(
    out: Option<&mut MaybeUninit<*mut T>>,
    run: impl FnOnce() -> Result<T, Failure>,
) -> vps_status {
    call(|| {
        let out = place("out", out)?.write(std::ptr::null_mut());
        *out = Box::into_raw(Box::new(run()?));
        Ok(())
    })
}

/// Ends a handle.
///
/// # Safety
/// Null, or a handle that [`make`] gave and that nothing uses any more.
pub(crate) unsafe fn free<T>(handle: *mut T) {
    if !handle.is_null() {
        // SAFETY: as the caller promises.
        let owned = unsafe { Box::from_raw(handle) };
        // A destructor that panics must not unwind into C.
        let _ = catch_unwind(AssertUnwindSafe(|| drop(owned)));
    }
}

/// Three numbers of the caller.
///
/// # Safety
/// Null, or the first of three numbers.
pub(crate) unsafe fn triple(name: &str, first: *const f64) -> Result<[f64; 3], Failure> {
    // SAFETY: as the caller promises.
    match unsafe { slice(name, first.cast::<[f64; 3]>(), usize::from(!first.is_null())) }? {
        [triple] => Ok(*triple),
        _ => Err(refused(name, "is null")),
    }
}

/// An array of the caller; null is one of no elements.
///
/// # Safety
/// `first` is null, or the first of `n` values that nothing writes meanwhile.
pub(crate) unsafe fn slice<'a, T>(
    name: &str,
    first: *const T,
    n: usize,
) -> Result<&'a [T], Failure> {
    check_array(name, first, n)?;
    // SAFETY: not null, aligned and not too long for an object; the caller promises the rest.
    Ok(if n == 0 { &[] } else { unsafe { std::slice::from_raw_parts(first, n) } })
}

/// An array that the caller wants filled; null is one of no places.
///
/// # Safety
/// `first` is null, or the first of `n` places that nothing else uses meanwhile.
pub(crate) unsafe fn places<'a, T>(
    name: &str,
    first: *mut T,
    n: usize,
) -> Result<&'a mut [MaybeUninit<T>], Failure> {
    check_array(name, first, n)?;
    // SAFETY: as above.
    Ok(if n == 0 { &mut [] } else { unsafe { std::slice::from_raw_parts_mut(first.cast(), n) } })
}

fn check_array<T>(name: &str, first: *const T, n: usize) -> Result<(), Failure> {
    if n == 0 {
        return Ok(());
    }
    if first.is_null() {
        return Err(refused(name, &format!("is null: give {n} elements")));
    }
    if !first.is_aligned() {
        return Err(refused(
            name,
            &format!("is not aligned: give a multiple of {} bytes", align_of::<T>()),
        ));
    }
    if n > isize::MAX as usize / size_of::<T>() {
        return Err(refused(name, &format!("has {n} elements, more than fit into memory")));
    }
    Ok(())
}

/// The name of a file.
///
/// # Safety
/// Null, or a string that ends with a zero byte.
pub(crate) unsafe fn path<'a>(name: *const c_char) -> Result<&'a Path, Failure> {
    if name.is_null() {
        return Err(refused("path", "is null"));
    }
    // SAFETY: as the caller promises.
    Ok(Path::new(OsStr::from_bytes(unsafe { CStr::from_ptr(name) }.to_bytes())))
}

/// Sentences for a user, a line each.
pub(crate) fn lines(sentences: &[String]) -> CString {
    CString::new(sentences.join("\n").replace('\0', " ")).unwrap_or_default()
}

/// The text of a handle; empty of a null one.
pub(crate) fn text(text: Option<&CString>) -> *const c_char {
    text.map_or(c"".as_ptr(), |text| text.as_ptr())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_ends_at_the_border_with_its_text() {
        std::panic::set_hook(Box::new(|_| ()));
        let mut out = MaybeUninit::new(std::ptr::dangling_mut::<u32>());
        let status = make(Some(&mut out), || panic!("the {}th point", 7));
        let _ = std::panic::take_hook();
        assert_eq!(status, VPS_ERROR_INTERNAL);
        // SAFETY: `make` writes it first; the text is a string of this thread.
        let (handle, text) = unsafe { (out.assume_init(), CStr::from_ptr(vps_last_error())) };
        assert!(handle.is_null());
        assert_eq!(text.to_str(), Ok("a mistake in libvps, please report it: the 7th point"));
        // Another thread has its own.
        assert!(
            std::thread::spawn(|| LAST_ERROR.with_borrow(|text| text.is_empty())).join().unwrap()
        );
    }
}
