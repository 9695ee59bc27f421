//! `set-up`: brings what the other tasks need, and says what it cannot bring.
//!
//! Nothing here fails for want of something optional: each need is either met, or
//! reported with the command that a person would type.

use anyhow::{Result, anyhow, bail};

use crate::console;
use crate::tasks::firmware::pin::Pin;
use crate::tasks::firmware::toolchain::{self, TARGETS, Toolchain};
use crate::tasks::{dependencies as trust, fuzz};
use crate::tools::{browser, emulators, readers, referee, spelling};
use crate::workspace::{Workspace, execute, find_program, output};

/// Installs what tests, firmware, fuzzing and benchmarks need.
///
/// What is there already is left alone. The compiler that firmware/boards/rust-toolchain.toml
/// pins comes from rustup; where it cannot bring it, Debian's compiler and its sources come from
/// apt-get (as root only). QEMU, node and chromium come from apt-get too, and the emulated Pico's packages
/// from npm. cargo-deny and cargo-vet are compiled, typos and other readers of clouds come from Python's packages.
/// LinuxCNC's interpreter is unpacked into the target directory from Debian's package.
/// What cannot be installed is named, with the command to type, and is no failure.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cargo xtask set-up\n  sudo -E cargo xtask set-up   # where Debian packages are missing"
)]
pub(crate) struct Arguments {}

/// Something that a task needs beyond Rust itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Need {
    /// A compiler for the bare-metal targets.
    Firmware,
    /// QEMU, and node with what the emulated Pico is made of.
    Emulators,
    /// cargo-deny and cargo-vet.
    Dependencies,
    /// typos.
    Spelling,
    /// A C++ compiler, which libFuzzer is built with.
    Fuzzing,
    /// LinuxCNC's interpreter, to judge NC programs.
    Referee,
    /// A browser, to draw a scan's page.
    Browser,
    /// Other readers of the clouds that are written.
    Readers,
    /// valgrind, to count instructions.
    Counting,
}

/// What the tests need.
pub const OF_TESTS: [Need; 7] = [
    Need::Firmware,
    Need::Emulators,
    Need::Dependencies,
    Need::Spelling,
    Need::Referee,
    Need::Browser,
    Need::Readers,
];

/// Meets every need.
pub fn run(workspace: &Workspace, _: &Arguments) -> Result<()> {
    let needs: Vec<Need> = OF_TESTS
        .into_iter()
        .chain([Need::Fuzzing, Need::Counting])
        .collect();
    announce(workspace, &needs);
    meet(workspace, &needs);
    Ok(())
}

/// Says what will be installed, and about how long that takes.
pub fn announce(workspace: &Workspace, needs: &[Need]) {
    let plan: Vec<(String, u32)> = needs
        .iter()
        .filter_map(|need| need.to_install(workspace))
        .collect();
    console::progress(&announced(&plan));
}

fn announced(plan: &[(String, u32)]) -> String {
    if plan.is_empty() {
        return "installs nothing: all of it is there".to_owned();
    }
    let seconds: u32 = plan.iter().map(|(_, seconds)| seconds).sum();
    let what: Vec<String> = plan
        .iter()
        .map(|(what, seconds)| format!("{what} ({seconds} s)"))
        .collect();
    format!(
        "installs, in about {} min: {}",
        seconds.div_ceil(60),
        what.join("; ")
    )
}

/// Meets `needs` as far as this machine allows; returns what is not met, and why.
pub fn meet(workspace: &Workspace, needs: &[Need]) -> Vec<String> {
    let mut unmet = Vec::new();
    let mut say = |need: &Need, met: Result<String>| {
        let name = need.name();
        match met {
            Ok(what) => console::progress(&format!("{name}: {what}")),
            Err(why) => {
                console::skipped(&format!("{name}: {why:#}"));
                unmet.push(format!("{name}: {why:#}"));
            }
        }
    };
    let (compiled, others): (Vec<Need>, Vec<Need>) =
        needs.iter().partition(|need| **need == Need::Dependencies);
    // What is compiled keeps the processors busy, what is unpacked the network and the disk: at once.
    std::thread::scope(|scope| {
        let compiled: Vec<_> = compiled
            .into_iter()
            .map(|need| (need, scope.spawn(move || need.meet(workspace))))
            .collect();
        for need in &others {
            say(need, need.meet(workspace));
        }
        for (need, compiling) in compiled {
            let met = compiling.join();
            say(
                &need,
                met.unwrap_or_else(|_| Err(anyhow!("it came to no end"))),
            );
        }
    });
    unmet
}

impl Need {
    fn name(self) -> &'static str {
        match self {
            Self::Firmware => "compiler for firmware",
            Self::Emulators => "emulators of boards",
            Self::Dependencies => "check of dependencies",
            Self::Spelling => "check of spelling",
            Self::Fuzzing => "fuzzing",
            Self::Referee => "referee of NC programs",
            Self::Browser => "browser",
            Self::Readers => "other readers of clouds",
            Self::Counting => "instruction counts",
        }
    }

    /// What is to be installed for it, and in about how many seconds on two cores.
    fn to_install(self, workspace: &Workspace) -> Option<(String, u32)> {
        match self {
            Self::Firmware => (!has_pinned(workspace)).then(|| {
                let release =
                    Pin::read(workspace).map_or_else(|_| String::new(), |pin| pin.channel);
                (format!("Rust {release} for the boards, by rustup"), 40)
            }),
            Self::Emulators => {
                let mut what = emulators::missing_packages();
                let seconds = 20 * what.len() as u32 + 10;
                if what.is_empty() && emulators::missing(workspace).is_some() {
                    what.push("rp2040js");
                }
                (!what.is_empty()).then(|| (what.join(" "), seconds))
            }
            Self::Dependencies => {
                let what = compiled_for_dependencies();
                let names: Vec<&str> = what.iter().map(|[name, ..]| *name).collect();
                (!what.is_empty()).then(|| (names.join(" and "), 75 * what.len() as u32))
            }
            Self::Spelling => spelling::find(workspace)
                .is_none()
                .then(|| ("typos".to_owned(), 5)),
            Self::Fuzzing => fuzz::missing().map(|_| ("g++".to_owned(), 30)),
            Self::Referee => {
                (!referee::is_there(workspace)).then(|| ("LinuxCNC's interpreter".to_owned(), 10))
            }
            Self::Browser => browser::find()
                .is_none()
                .then(|| (browser::DEBIAN_PACKAGE.to_owned(), 40)),
            Self::Readers => (!readers::are_there(workspace))
                .then(|| ("laspy, pye57 and pyarrow".to_owned(), 25)),
            Self::Counting => find_program("valgrind")
                .is_none()
                .then(|| ("valgrind".to_owned(), 20)),
        }
    }

    fn meet(self, workspace: &Workspace) -> Result<String> {
        match self {
            Self::Firmware => firmware(workspace),
            Self::Emulators => emulators(workspace),
            Self::Dependencies => dependencies(workspace),
            Self::Spelling => spelling::bring(workspace),
            Self::Fuzzing => fuzzing(workspace),
            Self::Referee => referee::bring(workspace),
            Self::Browser => a_browser(workspace),
            Self::Readers => readers::bring(workspace),
            Self::Counting => counting(workspace),
        }
    }
}

/// Whether the compiler that would be taken is the pinned one.
fn has_pinned(workspace: &Workspace) -> bool {
    toolchain::installed(workspace)
        .and_then(|toolchain| toolchain.compiler(workspace).ok())
        .is_some_and(|compiler| compiler.is_pinned)
}

fn firmware(workspace: &Workspace) -> Result<String> {
    if !has_pinned(workspace) && find_program("rustup").is_some() {
        bring_pinned(workspace)?;
    }
    if toolchain::installed(workspace).is_none() {
        install(workspace, &toolchain::DEBIAN_PACKAGES)?;
    }
    let toolchain = toolchain::choose(workspace, None)?;
    Ok(toolchain.compiler(workspace)?.to_string())
}

/// Has rustup bring the pinned compiler, or its targets to the active one. Neither may succeed.
fn bring_pinned(workspace: &Workspace) -> Result<()> {
    let pin = Pin::read(workspace)?;
    let active = Toolchain::Rustup.compiler(workspace);
    let is_active = active.is_ok_and(|compiler| compiler.is_pinned);
    // The active compiler may be the pinned release under another name, as `stable`.
    if !is_active && let Err(error) = execute(&mut pin.install(workspace)) {
        console::progress(&format!("{error:#}; trying the active compiler"));
    }
    if toolchain::installed(workspace).is_none() {
        let mut targets = workspace.command("rustup");
        targets.args(["target", "add"]).args(TARGETS);
        let mut components = workspace.command("rustup");
        components.args(["component", "add"]).args(&pin.components);
        if let Err(error) = execute(&mut targets).and_then(|()| execute(&mut components)) {
            console::progress(&format!("{error:#}; trying Debian's packages"));
        }
    }
    Ok(())
}

fn emulators(workspace: &Workspace) -> Result<String> {
    let missing = emulators::missing_packages();
    if !missing.is_empty() {
        install(workspace, &missing)?;
    }
    emulators::bring(workspace)
}

/// The programs that read lists of dependencies, with their releases, as far as they are to be compiled.
fn compiled_for_dependencies() -> Vec<[&'static str; 2]> {
    trust::PROGRAMS
        .into_iter()
        .filter(|[program, _]| find_program(program).is_none())
        .collect()
}

fn dependencies(workspace: &Workspace) -> Result<String> {
    for [program, version] in compiled_for_dependencies() {
        // Not optimised: it is compiled in a third of the time, and runs for seconds.
        execute(
            workspace
                .cargo()
                .args(["install", "--quiet", "--locked", "--debug"])
                .args(["--no-default-features", "--version", version])
                .arg(program)
                .env("CARGO_PROFILE_DEV_DEBUG", "0"),
        )?;
    }
    match trust::missing() {
        None => Ok(trust::PROGRAMS.map(|[program, _]| program).join(" and ")),
        Some(why) => bail!("{why}"),
    }
}

fn fuzzing(workspace: &Workspace) -> Result<String> {
    if fuzz::missing().is_some() {
        install(workspace, &["g++"])?;
    }
    Ok("libFuzzer".into())
}

fn a_browser(workspace: &Workspace) -> Result<String> {
    if browser::find().is_none() {
        install(workspace, &[browser::DEBIAN_PACKAGE])?;
    }
    match browser::find() {
        Some(found) => Ok(found.display().to_string()),
        None => bail!("no browser, though its package is installed"),
    }
}

fn counting(workspace: &Workspace) -> Result<String> {
    if find_program("valgrind").is_none() {
        install(workspace, &["valgrind"])?;
    }
    Ok("valgrind".into())
}

/// Installs Debian packages, as root; anyone else is told what to type.
fn install(workspace: &Workspace, packages: &[&str]) -> Result<()> {
    if find_program("apt-get").is_none() {
        bail!(
            "not a Debian system; install by other means: {}",
            packages.join(" ")
        );
    }
    let root = output(workspace.command("id").arg("-u")).is_ok_and(|id| id.trim() == "0");
    if !root {
        bail!(
            "not root; type: sudo apt-get install {}",
            packages.join(" ")
        );
    }
    execute(workspace.command("apt-get").args(["update", "--quiet=2"]))?;
    execute(
        workspace
            .command("apt-get")
            .args(["install", "--quiet=2", "--yes", "--no-install-recommends"])
            .args(packages)
            .env("DEBIAN_FRONTEND", "noninteractive"),
    )
}

#[cfg(test)]
mod tests {
    use super::announced;

    /// What is to come is named with its time, and the sum is in minutes, rounded up.
    #[test]
    fn plan_in_a_line() {
        assert_eq!(announced(&[]), "installs nothing: all of it is there");
        assert_eq!(
            announced(&[("cargo-deny".into(), 75), ("typos".into(), 5)]),
            "installs, in about 2 min: cargo-deny (75 s); typos (5 s)"
        );
    }
}
