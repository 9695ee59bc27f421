//! Which compiler builds for the bare-metal targets.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result};

use super::crate_names::WRAPS;
use super::pin::Pin;
use crate::workspace::{Workspace, find_program, output, shown};

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
pub(crate) enum Toolchain {
    /// The compiler that firmware/boards/rust-toolchain.toml pins, from rustup.
    Pinned,
    /// The active rustup toolchain, with the targets' libraries installed.
    Rustup,
    /// Debian's compiler, which builds the core library from its sources.
    Debian,
}

/// In the order in which they are preferred.
const ALL: [Toolchain; 3] = [Toolchain::Pinned, Toolchain::Rustup, Toolchain::Debian];

/// The compiler for firmware that is there, of this kind if one is asked for, or what to type
/// to get one.
pub fn choose(workspace: &Workspace, asked: Option<Toolchain>) -> Result<Toolchain> {
    let found = match asked {
        Some(toolchain) => toolchain.is_installed(workspace).then_some(toolchain),
        None => installed(workspace),
    };
    let pinned = format!("`{}`", shown(&Pin::read(workspace)?.install(workspace)));
    let rustup = format!("`rustup target add {}`", TARGETS.join(" "));
    let debian = format!("on Debian `apt-get install {}`", DEBIAN_PACKAGES.join(" "));
    let remedy = match asked {
        Some(Toolchain::Pinned) => pinned,
        Some(Toolchain::Rustup) => rustup,
        Some(Toolchain::Debian) => debian,
        None => format!("{pinned}, or {debian}"),
    };
    found.with_context(|| format!("no compiler for {}; type {remedy}", TARGETS.join(" and ")))
}

/// The compiler for firmware that is there, if one is: the pinned one before all others.
pub fn installed(workspace: &Workspace) -> Option<Toolchain> {
    ALL.into_iter()
        .find(|toolchain| toolchain.is_installed(workspace))
}

/// All compilers for firmware that are there; rustup's counts once.
pub fn all_installed(workspace: &Workspace) -> Vec<Toolchain> {
    let first = installed(workspace);
    first.into_iter().chain(second(workspace)).collect()
}

/// The other way to build the images: Debian's compiler beside rustup's.
pub fn second(workspace: &Workspace) -> Option<Toolchain> {
    let first = installed(workspace)?;
    (first != Toolchain::Debian && Toolchain::Debian.is_installed(workspace))
        .then_some(Toolchain::Debian)
}

/// A compiler as it is on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Compiler {
    /// What it calls itself.
    pub version: String,
    /// Where it comes from, and what its core library is.
    pub origin: &'static str,
    /// Whether the budgets are promises about it.
    pub is_pinned: bool,
    /// The release that is pinned.
    pub pinned: String,
}

impl fmt::Display for Compiler {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}", self.version, self.origin)?;
        if self.is_pinned {
            f.write_str(", as pinned")
        } else {
            write!(f, "; pinned is {}", self.pinned)
        }
    }
}

impl Toolchain {
    fn is_installed(self, workspace: &Workspace) -> bool {
        let Ok(pin) = Pin::read(workspace) else {
            return false;
        };
        match self {
            Self::Pinned => pin.is_complete(workspace, Some(&pin.channel)),
            Self::Rustup => pin.is_complete(workspace, None),
            Self::Debian => {
                Path::new(DEBIAN_CARGO).is_file()
                    && Path::new(DEBIAN_CLIPPY).is_file()
                    && find_program(DEBIAN_LINKER).is_some()
                    && debian_sources(workspace).is_some_and(|sources| sources.is_dir())
            }
        }
    }

    /// What it is on this machine.
    pub fn compiler(self, workspace: &Workspace) -> Result<Compiler> {
        let pin = Pin::read(workspace)?;
        let mut command = match self {
            Self::Pinned => {
                let mut command = workspace.command("rustup");
                command.args(["run", &pin.channel, "rustc"]);
                command
            }
            Self::Rustup => workspace.command("rustc"),
            Self::Debian => workspace.command(DEBIAN_RUSTC),
        };
        let version = output(command.arg("--version"))?.trim().to_owned();
        // Debian's builds the core library anew, with the image's own options: other bytes.
        let is_pinned = self != Self::Debian && pin.is_release(&version);
        Ok(Compiler {
            version,
            origin: match self {
                Self::Pinned | Self::Rustup => "rustup's with its core library",
                Self::Debian => "Debian's with the core library from source",
            },
            is_pinned,
            pinned: pin.channel,
        })
    }

    /// A `cargo build` of this toolchain, or its `cargo clippy`, for `target`, and for `cpu`
    /// where one is named. It puts its files into a folder of their own: it may be another
    /// compiler than the host's.
    pub fn cargo(
        self,
        workspace: &Workspace,
        verb: Verb,
        target: &str,
        cpu: Option<&str>,
    ) -> Result<Command> {
        // What `cargo xtask size` reads: it costs the image nothing. Unstable, but settled.
        let mut flags = vec!["-Zemit-stack-sizes".to_owned()];
        flags.extend(cpu.map(|cpu| format!("-Ctarget-cpu={cpu}")));
        if target.starts_with("thumbv6m") {
            // Unrolled, SHA-512 is 27 KB, and the cache of the Pico's flash holds 16: it would be fetched anew
            // for each 128 bytes.
            flags.push("--cfg=sha2_backend_soft=\"compact\"".to_owned());
        }
        flags.extend(same_paths_everywhere(workspace));
        let mut command = match (self, verb) {
            (Self::Pinned, _) => {
                let mut command = workspace.command("rustup");
                command.args(["run", &Pin::read(workspace)?.channel, "cargo"]);
                // Cargo takes these before the compiler beside it.
                command.env_remove("CARGO").env_remove("RUSTC");
                command
            }
            (Self::Rustup, _) => workspace.cargo(),
            (Self::Debian, Verb::Build) => workspace.command(DEBIAN_CARGO),
            // Cargo would find rustup's first.
            (Self::Debian, Verb::Clippy) => workspace.command(DEBIAN_CLIPPY),
        };
        command.arg(match verb {
            Verb::Build => "build",
            Verb::Clippy => "clippy",
        });
        if verb == Verb::Build {
            let this = std::env::current_exe().context("where this program is")?;
            command.env("RUSTC_WRAPPER", this).env(WRAPS, "1");
        }
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
            .env("CARGO_TARGET_DIR", self.build(workspace))
            .args(["--profile=firmware", "--target", target, "--config", &flags]);
        Ok(command)
    }

    /// Where cargo puts what it makes: a folder for each compiler, so that one does not build
    /// anew what the other has built.
    pub fn build(self, workspace: &Workspace) -> PathBuf {
        workspace.firmware().join(match self {
            Self::Pinned => "build",
            Self::Rustup => "build-rustup",
            Self::Debian => "build-debian",
        })
    }
}

/// Options by which the place of the checkout and of cargo's registry are not in the image:
/// the lines that panics name would make it longer where the paths are.
fn same_paths_everywhere(workspace: &Workspace) -> Vec<String> {
    let mut options = vec![format!(
        "--remap-path-prefix={}=openumi",
        workspace.root.display()
    )];
    let cargo_home = std::env::var_os("CARGO_HOME")
        .map(PathBuf::from)
        .or_else(|| Some(std::env::home_dir()?.join(".cargo")));
    // The folder of a registry has a name that begins with its host and ends in a hash.
    let registries = cargo_home.map(|home| home.join("registry").join("src"));
    let registries = registries.and_then(|folder| std::fs::read_dir(folder).ok());
    for registry in registries.into_iter().flatten().flatten() {
        options.push(format!(
            "--remap-path-prefix={}=crates",
            registry.path().display()
        ));
    }
    options.sort();
    options
}

/// What cargo is to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verb {
    /// Compile and link.
    Build,
    /// Look for what could be written better.
    Clippy,
}

/// Where Debian keeps the sources of the core library of a compiler that is new enough.
fn debian_sources(workspace: &Workspace) -> Option<PathBuf> {
    let version = output(workspace.command(DEBIAN_RUSTC).arg("--version")).ok()?;
    if minor_version(&version)? < minor_version(env!("CARGO_PKG_RUST_VERSION"))? {
        return None;
    }
    let sysroot = output(workspace.command(DEBIAN_RUSTC).args(["--print", "sysroot"])).ok()?;
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
