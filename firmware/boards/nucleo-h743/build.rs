//! Holds the plan of the pins against what the chip's maker publishes, and puts the
//! linker's script where it is found.

use std::path::PathBuf;
use std::{env, fs, io};

use stm32_metapac::metadata::METADATA;

#[path = "src/resources.rs"]
#[allow(
    dead_code,
    clippy::indexing_slicing,
    reason = "the rest is for the firmware; in a constant the compiler finds what is outside"
)]
mod resources;

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed=src/resources.rs");
    for planned in resources::SIGNALS {
        if !exists(&planned) {
            let resources::Signal {
                pin: (port, number),
                peripheral,
                signal,
                function,
            } = planned;
            println!(
                "cargo::error=resources.rs: P{port}{number} is not {signal} of {peripheral} \
                 as alternate function {function}"
            );
        }
    }

    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or(io::ErrorKind::NotFound)?);
    let has = |feature: &str| env::var_os(format!("CARGO_FEATURE_{feature}")).is_some();
    let flash = if has("BOOT") {
        "flash-boot.x"
    } else if has("SLOT_A") {
        "flash-slot-a.x"
    } else if has("SLOT_B") {
        "flash-slot-b.x"
    } else {
        "flash-whole.x"
    };
    let parts = [flash, "memory.x"];
    let texts: Result<Vec<String>, io::Error> = parts.iter().map(fs::read_to_string).collect();
    fs::write(out.join("memory.x"), texts?.concat())?;
    for part in parts {
        println!("cargo::rerun-if-changed={part}");
    }
    println!("cargo::rustc-link-search={}", out.display());
    // Without it the linker pads segments to pages, which flash has not.
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // The boot loader does not log.
    if !has("BOOT") {
        println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    }
    Ok(())
}

/// Whether the chip has this signal there.
fn exists(planned: &resources::Signal) -> bool {
    let (port, number) = planned.pin;
    let name = format!("P{port}{number}");
    METADATA
        .peripherals
        .iter()
        .filter(|peripheral| peripheral.name == planned.peripheral)
        .flat_map(|peripheral| peripheral.pins)
        .any(|pin| {
            pin.pin == name && pin.signal == planned.signal && pin.af == Some(planned.function)
        })
}
