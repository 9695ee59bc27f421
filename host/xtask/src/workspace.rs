//! Where things are, and how commands are run there.

use std::ffi::OsStr;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context as _, Result, bail, ensure};

use crate::console;

/// The checkout and its target directory.
pub(crate) struct Workspace {
    /// The folder of the workspace's `Cargo.toml`.
    pub root: PathBuf,
    /// Cargo's target directory, wherever the user has put it.
    pub target: PathBuf,
}

impl Workspace {
    /// Finds the checkout that this program was built from.
    pub fn find() -> Result<Self> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"))
            .ancestors()
            .nth(2)
            .context("host/xtask lies two folders below the root")?
            .to_owned();
        let mut workspace = Self {
            target: root.join("target"),
            root,
        };
        let target = workspace
            .members(&workspace.root.join("Cargo.toml"))?
            .pointer("/target_directory")
            .and_then(|value| value.as_str())
            .context("cargo metadata names no target directory")?
            .into();
        workspace.target = target;
        Ok(workspace)
    }

    /// `program`, to be run in the root of the checkout.
    pub fn command(&self, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new(program);
        command.current_dir(&self.root);
        command
    }

    /// The cargo that runs this program.
    pub fn cargo(&self) -> Command {
        self.command(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
    }

    /// Where the firmware's images are put.
    pub fn firmware(&self) -> PathBuf {
        self.target.join("firmware")
    }

    /// What cargo knows about the members of the workspace of this manifest.
    pub fn members(&self, manifest: &Path) -> Result<serde_json::Value> {
        metadata(
            self.cargo()
                .args(["metadata", "--no-deps", "--manifest-path"])
                .arg(manifest),
        )
    }
}

/// Runs a command in sight of the user; its failure is an error that names it.
pub fn execute(command: &mut Command) -> Result<()> {
    let child = start(command)?;
    finish(command, child)
}

/// Runs a command in sight of the user, but for lines of its standard error that are not
/// worth showing.
pub fn execute_filtered(
    command: &mut Command,
    mut worth_showing: impl FnMut(&str) -> bool,
) -> Result<()> {
    let mut child = start(command.stderr(Stdio::piped()))?;
    if let Some(said) = child.stderr.take() {
        for line in BufReader::new(said).split(b'\n') {
            let line = line.context("the command's output cannot be read")?;
            let line = String::from_utf8_lossy(&line);
            if worth_showing(&line) {
                eprintln!("{line}");
            }
        }
    }
    finish(command, child)
}

fn start(command: &mut Command) -> Result<Child> {
    let line = shown(command);
    console::progress(&format!("$ {line}"));
    command
        .spawn()
        .with_context(|| format!("cannot start `{line}`"))
}

fn finish(command: &Command, mut child: Child) -> Result<()> {
    let status = child.wait().context("the command cannot be waited for")?;
    ensure!(status.success(), "`{}` failed ({status})", shown(command));
    Ok(())
}

/// Runs a command out of sight and returns what it printed.
pub fn output(command: &mut Command) -> Result<String> {
    let line = shown(command);
    let output = command
        .stdin(Stdio::null())
        .output()
        .with_context(|| format!("cannot start `{line}`"))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        bail!("`{line}` failed ({}): {}", output.status, said.trim());
    }
    String::from_utf8(output.stdout).with_context(|| format!("`{line}` printed no UTF-8"))
}

/// Runs a `cargo metadata` and returns what it found.
pub fn metadata(command: &mut Command) -> Result<serde_json::Value> {
    let text = output(command.args(["--format-version=1", "--quiet"]))?;
    serde_json::from_str(&text).context("cargo metadata is not JSON")
}

/// Where `program` lies on the PATH, if it does.
pub fn find_program(program: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .map(|folder| folder.join(program))
        .find(|file| file.is_file())
}

/// Whether this runs in CI, where a check that a desk may skip is required.
pub fn in_ci() -> bool {
    std::env::var_os("CI").is_some_and(|value| !value.is_empty() && value != "false")
}

/// The command as one would type it.
pub fn shown(command: &Command) -> String {
    let program = Path::new(command.get_program());
    // The full path of cargo says nothing; that of another compiler's does.
    let name = match std::env::var_os("CARGO") {
        Some(cargo) if Path::new(&cargo) == program => "cargo".into(),
        _ => program.to_string_lossy(),
    };
    let mut line = String::new();
    for (name, value) in command.get_envs() {
        if let Some(value) = value {
            let (name, value) = (name.to_string_lossy(), quoted(&value.to_string_lossy()));
            line.push_str(&format!("{name}={value} "));
        }
    }
    line.push_str(&name);
    for argument in command.get_args() {
        line.push(' ');
        line.push_str(&quoted(&argument.to_string_lossy()));
    }
    line
}

fn quoted(word: &str) -> String {
    if word.is_empty() || word.contains([' ', '\'', '"', '$', '*', '(', ';', '&', '|']) {
        format!("'{}'", word.replace('\'', r"'\''"))
    } else {
        word.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The line that is shown can be pasted into a shell.
    #[test]
    fn shown_line_can_be_typed() {
        let mut command = Command::new("tool");
        command
            .args(["--say", "it's me"])
            .env("FLAGS", "-D warnings");
        assert_eq!(
            shown(&command),
            r"FLAGS='-D warnings' tool --say 'it'\''s me'"
        );
    }

    /// A failing command is an error that names the command and what it said.
    #[test]
    fn failure_names_the_command() {
        let mut command = Command::new("sh");
        command.args(["-c", "echo no such thing >&2; exit 3"]);
        let error = output(&mut command).unwrap_err().to_string();
        assert!(error.contains("sh -c"), "{error}");
        assert!(error.contains("no such thing"), "{error}");
    }
}
