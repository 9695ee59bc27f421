//! Where a command writes: one rule for the files of all commands.
//!
//! A file that is there is replaced with `--force` only. What the command reads is never
//! replaced, by whatever name or link it is meant. A device or a pipe is no such file.

use std::path::{Path, PathBuf};

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
    /// Whether what is there is to be replaced.
    pub const fn is_given(self) -> bool {
        self.force
    }

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

    /// The same of several outputs, of which each has a name of its own.
    ///
    /// # Errors
    /// `file`: one is there, is read, or is another one, too.
    pub fn check_each<'a>(
        self,
        outputs: impl IntoIterator<Item = &'a PathBuf>,
        inputs: &[&Path],
    ) -> Result<(), Failure> {
        let outputs: Vec<&PathBuf> = outputs.into_iter().collect();
        distinct(outputs.iter().map(|output| output.as_path()))?;
        outputs
            .into_iter()
            .try_for_each(|output| self.check(output, inputs))
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

/// Refuses standard output as a file's name, where a command's answer goes there.
///
/// # Errors
/// `file`.
pub(crate) fn no_stream(output: &Path) -> Result<(), Failure> {
    if output == Path::new("-") {
        return Err(Failure::trouble(
            "file",
            "- is no file's name here: standard output has this command's answer. Name a file",
        ));
    }
    Ok(())
}

/// Refuses two outputs of a command that are one file.
///
/// # Errors
/// `file`: the second would replace the first.
pub(crate) fn distinct<'a>(outputs: impl IntoIterator<Item = &'a Path>) -> Result<(), Failure> {
    let mut places: Vec<std::path::PathBuf> = Vec::new();
    for output in outputs {
        let place = place(output);
        if places.contains(&place) {
            return Err(Failure::trouble(
                "file",
                format_args!(
                    "{} would be written twice by this command: give each output a name of its own",
                    output.display()
                ),
            ));
        }
        places.push(place);
    }
    Ok(())
}

/// The one name of a file, whether it is there or not.
fn place(path: &Path) -> std::path::PathBuf {
    if let Ok(place) = path.canonicalize() {
        return place;
    }
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    match (
        whole.parent().and_then(|p| p.canonicalize().ok()),
        whole.file_name(),
    ) {
        (Some(folder), Some(name)) => folder.join(name),
        _ => whole,
    }
}

/// Older files under the names of a command's outputs. They go when the command has succeeded; when it has not, they stay
/// beside, as `NAME.old`: they must not be taken for its answer, and are not lost.
pub(crate) struct SetAside {
    outputs: Vec<std::path::PathBuf>,
    moved: Vec<[std::path::PathBuf; 2]>,
}

impl SetAside {
    /// Renames what is there. A link, a device or a pipe stays.
    pub fn new(outputs: Vec<std::path::PathBuf>) -> Self {
        let mut moved = Vec::new();
        for path in &outputs {
            if !path.symlink_metadata().is_ok_and(|found| found.is_file()) {
                continue;
            }
            let beside = (0..100).map(|k| {
                let mut name = path.clone().into_os_string();
                name.push(if k == 0 {
                    ".old".to_owned()
                } else {
                    format!(".old{k}")
                });
                std::path::PathBuf::from(name)
            });
            let free = beside.into_iter().find(|b| b.symlink_metadata().is_err());
            if let Some(free) = free
                && std::fs::rename(path, &free).is_ok()
            {
                moved.push([path.clone(), free]);
            }
        }
        Self { outputs, moved }
    }

    /// Ends a command: on success the older files go; otherwise what was written goes, and a note names where the older
    /// files are.
    pub fn end(self, succeeded: bool) -> Option<String> {
        if succeeded {
            for [_, beside] in &self.moved {
                let _ = std::fs::remove_file(beside);
            }
            return None;
        }
        for path in &self.outputs {
            if path.symlink_metadata().is_ok_and(|found| found.is_file()) {
                let _ = std::fs::remove_file(path);
            }
        }
        let kept = self
            .moved
            .iter()
            .map(|[_, beside]| beside.display().to_string());
        let kept: Vec<String> = kept.collect();
        (!kept.is_empty()).then(|| format!("The older file is kept as {}.", kept.join(", ")))
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
