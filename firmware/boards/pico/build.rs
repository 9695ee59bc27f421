//! Gives the linker the memory of the chip that is built for.

use std::path::PathBuf;
use std::{env, fs, io};

fn main() -> io::Result<()> {
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or(io::ErrorKind::NotFound)?);
    let memory = if env::var_os("CARGO_FEATURE_RP2350").is_some() {
        "memory-rp2350.x"
    } else {
        "memory-rp2040.x"
    };
    let parts = [memory, "ram-code.x"];
    let texts: Result<Vec<String>, io::Error> = parts.iter().map(fs::read_to_string).collect();
    fs::write(out.join("memory.x"), texts?.concat())?;
    for part in parts {
        println!("cargo::rerun-if-changed={part}");
    }
    println!("cargo::rustc-link-search={}", out.display());
    // Without it the linker pads segments to pages, which flash has not.
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // The application logs; the figures do not.
    for bin in ["umi-pico", "selftest"] {
        println!("cargo::rustc-link-arg-bin={bin}=-Tdefmt.x");
    }
    Ok(())
}
