//! The firmware's crates in one image that has no allocator.
//!
//! It links only if none of them needs a heap, and what is left of them in it is what a
//! board would carry, which `cargo xtask firmware-check` measures. It is never run.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod image;

/// On a host there is nothing to link.
#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("This image is for bare metal: `cargo xtask firmware-check` builds it.");
}
