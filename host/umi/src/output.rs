//! Where a command writes: one rule for the files of all commands.
//!
//! A file that is there is replaced with `--force` only. What the command reads is never
//! replaced, by whatever name or link it is meant. A device or a pipe is no such file.

use std::path::Path;

use clap::Args;

use crate::failure::Failure;

/// Whether files may be replaced.
#[derive(Args, Clone, Copy)]
pub(crate) struct Force {
    /// Replace an output that is there already
    #[arg(long)]
    force: bool,
}

impl Force {
    /// Refuses an output that is there already, or that is one of the inputs.
    ///
    /// # Errors
    /// `file`: the output is there, or is read.
    pub fn check(self, output: &Path, inputs: &[&Path]) -> Result<(), Failure> {
        if output == Path::new("-") {
            return Ok(());
        }
        if let Some(input) = inputs.iter().find(|input| is_same(output, input)) {
            return Err(Failure::trouble(
                "file",
                format_args!(
                    "{} is {}, which is read: give another name; --force does not replace it",
                    output.display(),
                    input.display()
                ),
            ));
        }
        // A link that leads nowhere is there, too.
        let is_there = output.symlink_metadata().is_ok()
            && output.metadata().map_or(true, |found| found.is_file());
        if is_there && !self.force {
            return Err(Failure::trouble(
                "file",
                format_args!(
                    "{} is there already: give another name, or --force to replace it",
                    output.display()
                ),
            ));
        }
        Ok(())
    }

    /// Writes a file by this rule.
    ///
    /// # Errors
    /// As [`Self::check`], or it cannot be written.
    pub fn write(
        self,
        output: &Path,
        inputs: &[&Path],
        bytes: impl AsRef<[u8]>,
    ) -> Result<(), Failure> {
        self.check(output, inputs)?;
        std::fs::write(output, bytes).map_err(|error| Failure::file("write", output, &error))
    }
}

/// Whether two paths lead to the same file: by name, symbolic link or hard link.
fn is_same(a: &Path, b: &Path) -> bool {
    let (Ok(found), Ok(other)) = (a.metadata(), b.metadata()) else {
        return false;
    };
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        (found.dev(), found.ino()) == (other.dev(), other.ino())
    }
    #[cfg(not(unix))]
    {
        let _ = (found, other);
        matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
    }
}
