//! What the firmware's crates may depend on.
//!
//! The brain and the protocol know no executor and no hardware, and the application
//! knows only embassy's channels and clocks; the drivers that boards share know traits and
//! USB, but no chip. That is what lets them run on a laptop.
//! Nothing of theirs asks a dependency for the standard library or a heap.

use anyhow::{Result, bail};

use super::toolchain::TARGETS;
use crate::workspace::{Workspace, output};

/// What of embassy a crate may use, and which traits of hardware.
struct Rule {
    package: &'static str,
    embassy: &'static [&'static str],
    hardware: &'static [&'static str],
}

const RULES: [Rule; 4] = [
    Rule {
        package: "umi-protocol",
        embassy: &[],
        hardware: &[],
    },
    Rule {
        package: "umi-core",
        embassy: &[],
        hardware: &[],
    },
    Rule {
        package: "umi-app",
        embassy: &[
            "embassy-sync",
            "embassy-futures",
            "embassy-time",
            "embassy-time-driver",
        ],
        hardware: &[],
    },
    Rule {
        package: "umi-drivers",
        embassy: &[
            "embassy-sync",
            "embassy-futures",
            "embassy-time",
            "embassy-time-driver",
            "embassy-usb",
            "embassy-usb-driver",
            // What embassy-usb's network class, which nothing here uses, is made of.
            "embassy-net-driver",
            "embassy-net-driver-channel",
        ],
        hardware: &["embedded-hal", "embedded-hal-async", "usb-device"],
    },
];

/// Crates that know a processor or a peripheral, by what their names begin with.
const HARDWARE: [&str; 10] = [
    "cortex-m",
    "embedded-hal",
    "stm32",
    "rp2040",
    "rp235x",
    "rp-pac",
    "rp-hal",
    "nrf",
    "usb-device",
    "defmt-rtt",
];

/// Holds every rule on every target; the error lists all that break one.
pub fn check(workspace: &Workspace) -> Result<()> {
    let mut broken = Vec::new();
    for rule in &RULES {
        for target in TARGETS {
            let tree = output(workspace.cargo().args([
                "tree",
                "--quiet",
                "--package",
                rule.package,
                "--target",
                target,
                "--edges=normal",
                "--prefix=none",
                "--format={p}|{f}",
            ]))?;
            for problem in problems(rule, &tree) {
                let line = format!("{} {problem}", rule.package);
                if !broken.contains(&line) {
                    broken.push(line);
                }
            }
        }
    }
    if !broken.is_empty() {
        bail!(
            "dependencies that firmware must not have:\n  {}",
            broken.join("\n  ")
        );
    }
    Ok(())
}

/// What in the output of `cargo tree` breaks the rule.
fn problems(rule: &Rule, tree: &str) -> Vec<String> {
    let mut problems = Vec::new();
    for line in tree.lines() {
        let (package, features) = line.split_once('|').unwrap_or((line, ""));
        let name = package.split_whitespace().next().unwrap_or_default();
        if name.starts_with("embassy") && !rule.embassy.contains(&name) {
            problems.push(format!("depends on {name}"));
        }
        let is_hardware =
            HARDWARE.iter().any(|start| name.starts_with(start)) || name.ends_with("-hal");
        if is_hardware && !rule.hardware.contains(&name) {
            problems.push(format!("depends on {name}, which knows hardware"));
        }
        // A procedural macro runs on the machine that compiles, and may use what it likes.
        if package.contains("(proc-macro)") {
            continue;
        }
        // Features are listed as `a,b`; cargo marks a repeated package with ` (*)`.
        for feature in features.trim_end_matches(" (*)").split(',') {
            if matches!(feature.trim(), "std" | "alloc" | "use-std") {
                problems.push(format!("asks {name} for its feature `{feature}`"));
            }
        }
    }
    problems
}

#[cfg(test)]
mod tests {
    use super::*;

    const BRAIN: &Rule = &RULES[1];
    const APPLICATION: &Rule = &RULES[2];

    /// Each kind of violation is seen, and named.
    #[test]
    fn violations() {
        let tree = "umi-core v0.1.0 (/x/firmware/core)|\n\
                    embassy-sync v0.7.2|\n\
                    embedded-hal v1.0.0|\n\
                    rp2040-hal v0.11.0|\n\
                    serde v1.0.228|default,std (*)\n";
        assert_eq!(
            problems(BRAIN, tree),
            [
                "depends on embassy-sync",
                "depends on embedded-hal, which knows hardware",
                "depends on rp2040-hal, which knows hardware",
                "asks serde for its feature `std`",
            ]
        );
    }

    /// The application may use embassy's channels but not its executor.
    #[test]
    fn application_knows_channels_only() {
        let tree = "embassy-sync v0.7.2|\nembassy-executor v0.10.0|platform-cortex-m\n";
        assert_eq!(problems(APPLICATION, tree), ["depends on embassy-executor"]);
    }

    /// Drivers may use traits of hardware, but know no chip and no executor.
    #[test]
    fn drivers_know_traits_only() {
        let tree = "embedded-hal v1.0.0|\n\
                    embassy-usb v0.6.0|\n\
                    rp-pac v7.0.0|\n\
                    embassy-rp v0.10.0|rp2040\n";
        assert_eq!(
            problems(&RULES[3], tree),
            [
                "depends on rp-pac, which knows hardware",
                "depends on embassy-rp",
            ]
        );
    }

    /// Macros run on the host, and mentions of alloc that are no feature do not count.
    #[test]
    fn what_is_allowed() {
        let tree = "serde_derive v1.0.228 (proc-macro)|default,std\n\
                    nalgebra v0.35.0|libm\n\
                    heapless v0.9.1|serde\n";
        assert!(problems(BRAIN, tree).is_empty());
    }
}
