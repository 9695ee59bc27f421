//! The compiler that the images are promised for: `firmware/boards/rust-toolchain.toml`.

use std::process::Command;

use anyhow::{Context as _, Result};
use serde::Deserialize;

use crate::workspace::{Workspace, output};

/// What the file pins.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Pin {
    /// The compiler's release, as `1.95.0`.
    pub channel: String,
    /// What rustup installs beside the components.
    pub profile: String,
    /// What else the checks need: clippy.
    pub components: Vec<String>,
    /// The processors.
    pub targets: Vec<String>,
}

#[derive(Deserialize)]
struct File {
    toolchain: Pin,
}

impl Pin {
    /// Reads the file.
    pub fn read(workspace: &Workspace) -> Result<Self> {
        let file = workspace.root.join("firmware/boards/rust-toolchain.toml");
        let text = std::fs::read_to_string(&file)
            .with_context(|| format!("cannot read {}", file.display()))?;
        Self::parse(&text).with_context(|| format!("{} is no pin", file.display()))
    }

    fn parse(text: &str) -> Result<Self> {
        Ok(toml::from_str::<File>(text)?.toolchain)
    }

    /// Whether rustup has `toolchain` (the active one if none is named) with all components
    /// and targets.
    pub fn is_complete(&self, workspace: &Workspace, toolchain: Option<&str>) -> bool {
        let list = |what: &str| {
            let mut command = workspace.command("rustup");
            command.args([what, "list", "--installed"]);
            if let Some(toolchain) = toolchain {
                command.args(["--toolchain", toolchain]);
            }
            output(&mut command).unwrap_or_default()
        };
        let targets = list("target");
        let has_targets = self
            .targets
            .iter()
            .all(|target| targets.lines().any(|line| line == target));
        has_targets && {
            let components = list("component");
            self.components
                .iter()
                .all(|component| components.lines().any(|line| is_component(line, component)))
        }
    }

    /// Whether what this compiler prints for `--version` is the pinned release.
    pub fn is_release(&self, version: &str) -> bool {
        version.split_whitespace().nth(1) == Some(&self.channel)
    }

    /// The command that installs the pinned compiler.
    pub fn install(&self, workspace: &Workspace) -> Command {
        let mut command = workspace.command("rustup");
        command
            .args(["toolchain", "install", &self.channel])
            .args(["--no-self-update", "--profile", &self.profile])
            .args(["--component", &self.components.join(",")])
            .args(["--target", &self.targets.join(",")]);
        command
    }
}

/// Whether rustup's line `clippy-x86_64-unknown-linux-gnu` is the component `clippy`.
fn is_component(line: &str, component: &str) -> bool {
    line.strip_prefix(component)
        .is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIN: &str = include_str!("../../../../../firmware/boards/rust-toolchain.toml");

    /// The file pins a release by number, never a channel that moves; it stands beside the
    /// boards and not at the top, where it would bind the host's code too.
    #[test]
    fn pins_a_release_of_the_boards_alone() {
        let pin = Pin::parse(PIN).unwrap();
        let numbers: Vec<u32> = pin
            .channel
            .split('.')
            .map(|it| it.parse().unwrap())
            .collect();
        assert_eq!(numbers.len(), 3, "{}", pin.channel);
        assert!(pin.components.iter().any(|component| component == "clippy"));
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
        for name in ["rust-toolchain.toml", "rust-toolchain"] {
            assert!(!std::path::Path::new(root).join(name).exists(), "{name}");
        }
    }

    /// Another release is not the pinned one, nor is one whose number only begins like it.
    #[test]
    fn releases() {
        let pin = Pin {
            channel: "1.95.0".into(),
            profile: "minimal".into(),
            components: vec![],
            targets: vec![],
        };
        assert!(pin.is_release("rustc 1.95.0 (59807616e 2026-04-14)"));
        assert!(!pin.is_release("rustc 1.96.0 (ac68faa20 2026-05-25)"));
        assert!(!pin.is_release("rustc 1.95.0-nightly (0123456 2026-02-01)"));
        assert!(!pin.is_release(""));
    }

    /// A component is known by its whole name.
    #[test]
    fn components() {
        assert!(is_component("clippy-x86_64-unknown-linux-gnu", "clippy"));
        assert!(!is_component("rust-std-thumbv6m-none-eabi", "rustfmt"));
        assert!(!is_component("rustc-x86_64", "rust-std"));
    }
}
