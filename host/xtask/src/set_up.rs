//! `set-up`: brings what the other chores need, and says what it cannot bring.
//!
//! Nothing here fails for want of something optional: each need is either met, or
//! reported with the command that a person would type.

use anyhow::Result;

use crate::console;
use crate::emulators;
use crate::firmware::toolchain::{self, TARGETS};
use crate::fuzz;
use crate::house::{House, execute, find_program, output};
use crate::referee;

/// Installs what tests, firmware, fuzzing and benchmarks need.
///
/// What is there already is left alone. Rust targets come from rustup; where it cannot
/// bring them, Debian's compiler and its sources come from apt-get (as root only).
/// QEMU and node come from apt-get too, and the emulated Pico's packages from npm.
/// LinuxCNC's interpreter is unpacked into the target directory from Debian's package.
/// What cannot be installed is named, with the command to type, and is no failure.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cargo xtask set-up\n  sudo -E cargo xtask set-up   # where Debian packages are missing"
)]
pub struct Arguments {}

/// Something that a chore needs beyond Rust itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// A compiler for the bare-metal targets.
    Firmware,
    /// QEMU, and node with what the emulated Pico is made of.
    Emulators,
    /// cargo-fuzz and a nightly compiler to run it with.
    Fuzzing,
    /// LinuxCNC's interpreter, to judge NC programs.
    Referee,
    /// valgrind, to count instructions.
    Counting,
}

/// Meets every need.
pub fn run(house: &House, _: &Arguments) -> Result<()> {
    meet(
        house,
        &[
            Need::Firmware,
            Need::Emulators,
            Need::Fuzzing,
            Need::Referee,
            Need::Counting,
        ],
    );
    Ok(())
}

/// Meets `needs` as far as this machine allows, and reports the rest.
pub fn meet(house: &House, needs: &[Need]) {
    for need in needs {
        let (name, met) = match need {
            Need::Firmware => ("compiler for firmware", firmware(house)),
            Need::Emulators => ("emulators of boards", emulators(house)),
            Need::Fuzzing => ("fuzzing", fuzzing(house)),
            Need::Referee => ("referee of NC programs", referee::bring(house)),
            Need::Counting => ("instruction counts", counting(house)),
        };
        match met {
            Ok(what) => console::progress(&format!("{name}: {what}")),
            Err(why) => console::skipped(&format!("{name}: {why:#}")),
        }
    }
}

fn firmware(house: &House) -> Result<String> {
    if let Some(toolchain) = toolchain::installed(house) {
        return Ok(toolchain.to_string());
    }
    if find_program("rustup").is_some() {
        let added = execute(
            house
                .command("rustup")
                .args(["target", "add"])
                .args(TARGETS),
        );
        if let Err(error) = added {
            console::progress(&format!("{error:#}; trying Debian's packages"));
        }
    }
    if toolchain::installed(house).is_none() {
        install(house, &toolchain::DEBIAN_PACKAGES)?;
    }
    toolchain::choose(house, None).map(|toolchain| toolchain.to_string())
}

fn emulators(house: &House) -> Result<String> {
    let missing = emulators::missing_packages();
    if !missing.is_empty() {
        install(house, &missing)?;
    }
    emulators::bring(house)
}

fn fuzzing(house: &House) -> Result<String> {
    if !fuzz::has_nightly(house) {
        anyhow::bail!("no nightly compiler; `rustup toolchain install nightly` brings one");
    }
    if find_program("cargo-fuzz").is_none() {
        execute(
            house
                .cargo()
                .args(["install", "--quiet", "--locked", "cargo-fuzz"]),
        )?;
    }
    Ok("cargo-fuzz with a nightly compiler".into())
}

fn counting(house: &House) -> Result<String> {
    if find_program("valgrind").is_none() {
        install(house, &["valgrind"])?;
    }
    Ok("valgrind".into())
}

/// Installs Debian packages, as root; anyone else is told what to type.
fn install(house: &House, packages: &[&str]) -> Result<()> {
    if find_program("apt-get").is_none() {
        anyhow::bail!(
            "not a Debian system; install by other means: {}",
            packages.join(" ")
        );
    }
    let root = output(house.command("id").arg("-u")).is_ok_and(|id| id.trim() == "0");
    if !root {
        anyhow::bail!(
            "not root; type: sudo apt-get install {}",
            packages.join(" ")
        );
    }
    execute(house.command("apt-get").args(["update", "--quiet=2"]))?;
    execute(
        house
            .command("apt-get")
            .args(["install", "--quiet=2", "--yes", "--no-install-recommends"])
            .args(packages)
            .env("DEBIAN_FRONTEND", "noninteractive"),
    )
}
