//! Ctrl-C and the system's wish that we end: noticed, so that work ends properly.

use std::sync::atomic::{AtomicBool, Ordering};

static CAME: AtomicBool = AtomicBool::new(false);

/// From now on an interrupt is noticed instead of ending the process; a second one
/// ends it.
pub fn watch() {
    // Where the system refuses, or this was done before, an interrupt ends the process.
    let _ = ctrlc::set_handler(|| {
        if CAME.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    });
}

/// Whether one came.
#[must_use]
pub fn came() -> bool {
    CAME.load(Ordering::Relaxed)
}
