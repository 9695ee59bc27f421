//! The firmware's checks, run on the side of others.
//!
//! They are another run of this program, so that what they say can be kept until it is asked
//! for: two commands that talk at once are not understood.

use std::fs::File;
use std::io::{Read as _, Seek as _};
use std::process::{Child, Command, Stdio};

use anyhow::{Context as _, Result, ensure};

use crate::firmware;
use crate::house::House;
use crate::size;

/// The name of the chore that runs them.
pub const CHORE: &str = "firmware-checks";

/// The checks: every image is built and within its budget, and its code has no lints.
pub fn run(house: &House) -> Result<()> {
    size::run(house, &size::Arguments::default())?;
    firmware::lint(house)
}

/// The checks as they run.
pub struct Aside {
    process: Child,
    said: File,
}

impl Aside {
    /// Begins them.
    pub fn begin(house: &House) -> Result<Self> {
        let mut command = house.command(std::env::current_exe()?);
        Self::begin_as(house, command.arg(CHORE))
    }

    fn begin_as(house: &House, command: &mut Command) -> Result<Self> {
        let folder = house.target.join("xtask");
        std::fs::create_dir_all(&folder)?;
        let file = folder.join("firmware-checks.log");
        let log = || {
            let mut options = File::options();
            let log = options.create(true).read(true).append(true).open(&file);
            log.with_context(|| format!("cannot write {}", file.display()))
        };
        log()?.set_len(0)?;
        let process = command
            .stdin(Stdio::null())
            .stdout(log()?)
            .stderr(log()?)
            .spawn()
            .context("the checks of the firmware do not start")?;
        Ok(Self {
            process,
            said: log()?,
        })
    }

    /// Waits for their end, and shows what they said.
    pub fn end(mut self) -> Result<()> {
        let status = self.process.wait()?;
        let mut said = Vec::new();
        self.said.rewind()?;
        self.said.read_to_end(&mut said)?;
        eprint!("{}", String::from_utf8_lossy(&said));
        ensure!(
            status.success(),
            "the firmware does not hold what it promises"
        );
        Ok(())
    }
}

/// Whoever does not wait for them does not want them.
impl Drop for Aside {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// Their failure is a failure at the end, and success is one.
    #[test]
    fn outcome() {
        let root = std::env::temp_dir().join(format!("umi-xtask-aside-{}", std::process::id()));
        let house = House {
            target: root.join("target"),
            root,
        };
        std::fs::create_dir_all(&house.root).unwrap();
        let end = |script: &str| {
            let mut command = house.command("sh");
            Aside::begin_as(&house, command.args(["-c", script]))
                .unwrap()
                .end()
        };
        assert!(end("exit 0").is_ok());
        assert!(end("exit 1").is_err());
        std::fs::remove_dir_all(&house.root).unwrap();
    }
}
