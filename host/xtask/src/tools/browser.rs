//! A browser that draws a page without a screen.

use std::path::PathBuf;

use crate::workspace::find_program;

/// What Debian's package is called.
pub const DEBIAN_PACKAGE: &str = "chromium";

const PROGRAMS: [&str; 3] = [DEBIAN_PACKAGE, "chromium-browser", "google-chrome"];

/// The first one that is here.
pub fn find() -> Option<PathBuf> {
    PROGRAMS.iter().find_map(|name| find_program(name))
}
