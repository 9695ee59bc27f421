//! Which compiler builds for the bare-metal targets.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result};

use crate::house::{House, find_program, output};

/// Cortex-M4/M7 with a floating-point unit, Cortex-M0+, and Cortex-M33 with one.
pub const TARGETS: [&str; 3] = [
    "thumbv7em-none-eabihf",
    "thumbv6m-none-eabi",
    "thumbv8m.main-none-eabihf",
];

/// What Debian calls a current compiler, its cargo and lints, the library's sources and a
/// linker.
pub const DEBIAN_PACKAGES: [&str; 5] = [
    "rustc-web",
    "cargo-web",
    "rust-web-clippy",
    "rust-web-src",
    "binutils-arm-none-eabi",
];

const DEBIAN_RUSTC: &str = "/usr/bin/rustc";
const DEBIAN_CARGO: &str = "/usr/bin/cargo";
const DEBIAN_CLIPPY: &str = "/usr/bin/cargo-clippy";
const DEBIAN_LINKER: &str = "arm-none-eabi-ld";

/// A compiler that can build for every target of [`TARGETS`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Toolchain {
    /// The active rustup toolchain, with the targets' libraries installed.
    Rustup,
    /// Debian's compiler, which builds the core library from its sources.
    Debian,
}

impl fmt::Display for Toolchain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Rustup => "the targets of rustup",
            Self::Debian => "Debian's rustc with the core library from source",
        })
    }
}

/// The compiler for firmware that is there, of this kind if one is asked for, or what to type
/// to get one.
pub fn choose(house: &House, asked: Option<Toolchain>) -> Result<Toolchain> {
    let found = match asked {
        Some(toolchain) => toolchain.is_installed(house).then_some(toolchain),
        None => installed(house),
    };
    let rustup = format!("`rustup target add {}`", TARGETS.join(" "));
    let debian = format!("on Debian `apt-get install {}`", DEBIAN_PACKAGES.join(" "));
    let remedy = match asked {
        Some(Toolchain::Rustup) => rustup,
        Some(Toolchain::Debian) => debian,
        None => format!("{rustup}, or {debian}"),
    };
    found.with_context(|| format!("no compiler for {}; type {remedy}", TARGETS.join(" and ")))
}

/// The compiler for firmware that is there, if one is.
pub fn installed(house: &House) -> Option<Toolchain> {
    [Toolchain::Rustup, Toolchain::Debian]
        .into_iter()
        .find(|toolchain| toolchain.is_installed(house))
}

impl Toolchain {
    fn is_installed(self, house: &House) -> bool {
        match self {
            Self::Rustup => {
                let list = house
                    .command("rustup")
                    .args(["target", "list", "--installed"])
                    .output();
                list.is_ok_and(|list| {
                    let list = String::from_utf8_lossy(&list.stdout);
                    TARGETS
                        .iter()
                        .all(|target| list.lines().any(|line| line == *target))
                })
            }
            Self::Debian => {
                Path::new(DEBIAN_CARGO).is_file()
                    && Path::new(DEBIAN_CLIPPY).is_file()
                    && find_program(DEBIAN_LINKER).is_some()
                    && debian_sources(house).is_some_and(|sources| sources.is_dir())
            }
        }
    }

    /// A `cargo build` of this toolchain, or its `cargo clippy`, for `target`, and for `cpu`
    /// where one is named. It puts its files into a folder of their own: it may be another
    /// compiler than the host's.
    pub fn cargo(self, house: &House, verb: Verb, target: &str, cpu: Option<&str>) -> Command {
        // What `cargo xtask size` reads: it costs the image nothing. Unstable, but settled.
        let mut flags = vec!["-Zemit-stack-sizes".to_owned()];
        flags.extend(cpu.map(|cpu| format!("-Ctarget-cpu={cpu}")));
        let mut command = match (self, verb) {
            (Self::Rustup, _) => house.cargo(),
            (Self::Debian, Verb::Build) => house.command(DEBIAN_CARGO),
            // Cargo would find rustup's first.
            (Self::Debian, Verb::Clippy) => house.command(DEBIAN_CLIPPY),
        };
        command.arg(match verb {
            Verb::Build => "build",
            Verb::Clippy => "clippy",
        });
        if self == Self::Debian {
            command
                .env("CARGO", DEBIAN_CARGO)
                .env("RUSTC", DEBIAN_RUSTC)
                // The libraries of the compiler that runs this program are not its.
                .env_remove("LD_LIBRARY_PATH")
                // Only core: whatever names alloc does not compile.
                .arg("-Zbuild-std=core");
            flags.push(format!("-Clinker={DEBIAN_LINKER}"));
        }
        // Without quotes: cargo looks for a target with a dot in two steps. Not by the
        // environment, whose names cannot have the dot.
        let flags = format!("target.{target}.rustflags={flags:?}");
        command
            // Building the core library is unstable in cargo, but Debian has no other way to
            // have it for a target; the stack sizes are unstable everywhere.
            .env("RUSTC_BOOTSTRAP", "1")
            .env("CARGO_TARGET_DIR", house.firmware().join("build"))
            .args(["--profile=firmware", "--target", target, "--config", &flags]);
        command
    }
}

/// What cargo is to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verb {
    /// Compile and link.
    Build,
    /// Look for what could be written better.
    Clippy,
}

/// Where Debian keeps the sources of the core library of a compiler that is new enough.
fn debian_sources(house: &House) -> Option<PathBuf> {
    let version = output(house.command(DEBIAN_RUSTC).arg("--version")).ok()?;
    if minor_version(&version)? < minor_version(env!("CARGO_PKG_RUST_VERSION"))? {
        return None;
    }
    let sysroot = output(house.command(DEBIAN_RUSTC).args(["--print", "sysroot"])).ok()?;
    Some(Path::new(sysroot.trim()).join("lib/rustlib/src/rust/library/core"))
}

/// The 96 of `rustc 1.96.0 (…)` and of `1.96`.
fn minor_version(version: &str) -> Option<u32> {
    let number = version.split_whitespace().find(|word| word.contains('.'))?;
    number.split('.').nth(1)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::minor_version;

    /// Debian's own rustc is too old for the workspace, which must be seen.
    #[test]
    fn minor_version_of_what_rustc_prints() {
        assert_eq!(
            minor_version("rustc 1.96.0 (ac68faa20 2026-05-25)"),
            Some(96)
        );
        assert_eq!(minor_version("rustc 1.63.0"), Some(63));
        assert_eq!(minor_version("1.89"), Some(89));
        assert_eq!(minor_version("rustc"), None);
    }
}
