//! Gives the linker the memory of the chip that is built for.

use std::path::PathBuf;
use std::{env, fs, io};

fn main() -> io::Result<()> {
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or(io::ErrorKind::NotFound)?);
    let has = |feature: &str| env::var_os(format!("CARGO_FEATURE_{feature}")).is_some();
    let parts: &[&str] = if has("SLOT_AB") {
        &["flash-rp2350-ab.x", "ram-rp2350.x", "ram-code.x"]
    } else if has("RP2350") {
        &["flash-rp2350.x", "ram-rp2350.x", "ram-code.x"]
    } else if has("BOOT") {
        &["flash-boot.x", "ram-rp2040.x"]
    } else if has("SLOT_A") {
        &["flash-slot-a.x", "ram-rp2040.x", "ram-code.x"]
    } else if has("SLOT_B") {
        &["flash-slot-b.x", "ram-rp2040.x", "ram-code.x"]
    } else {
        &["flash-rp2040.x", "ram-rp2040.x", "ram-code.x"]
    };
    let parts = parts.iter().map(|part| format!("link/{part}"));
    let mut memory = String::new();
    for part in parts {
        memory += &fs::read_to_string(&part)?;
        println!("cargo::rerun-if-changed={part}");
    }
    fs::write(out.join("memory.x"), memory)?;
    println!("cargo::rustc-link-search={}", out.display());
    // Without it the linker pads segments to pages, which flash has not.
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // The application logs; the figures do not.
    for bin in ["umi-pico", "selftest"] {
        if has("BOOT") {
            break;
        }
        println!("cargo::rustc-link-arg-bin={bin}=-Tdefmt.x");
    }
    Ok(())
}
