//! A part program on disk, with the programs that it calls as if they stood in its file.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use umi_core::rewrite::RefusedLine;

use crate::files::points::name;
use crate::problem::Problem;

/// Bytes that are read at a time.
pub(super) const PIECE: usize = 1 << 16;

/// A part program.
#[derive(Clone, Debug)]
pub struct PartProgram {
    path: PathBuf,
    /// All text, where other files belong to it.
    joined: Option<Joined>,
}

/// Several files as one text.
#[derive(Clone, Debug)]
struct Joined {
    text: Vec<u8>,
    files: Vec<JoinedFile>,
}

/// What of a file stands in the text.
#[derive(Clone, Debug)]
struct JoinedFile {
    path: PathBuf,
    /// Lines of it that were left out before the first.
    leader: u64,
    lines: u64,
}

impl PartProgram {
    /// The program of a file, with others behind it that it may call.
    ///
    /// # Errors
    /// A file cannot be read, another one does not say its O number, or a program comes twice.
    pub fn new(path: &Path, loaded: &[PathBuf]) -> Result<Self, Problem> {
        let mut program = Self {
            path: path.to_owned(),
            joined: None,
        };
        if loaded.is_empty() {
            return Ok(program);
        }
        let text = read(path)?;
        let end: &[u8] = match text.iter().position(|byte| matches!(byte, b'\n' | b'\r')) {
            Some(at) if text.get(at..at + 2) == Some(b"\r\n") => b"\r\n",
            Some(at) if text.get(at) == Some(&b'\r') => b"\r",
            _ => b"\n",
        };
        let (lines, _, closing) = body(&text);
        let mut all = Vec::new();
        let mut files = vec![JoinedFile {
            path: path.to_owned(),
            leader: 0,
            lines: lines.len() as u64,
        }];
        let mut put = |line: &[u8]| {
            all.extend_from_slice(line);
            all.extend_from_slice(end);
        };
        lines.iter().for_each(|line| put(line));
        let mut known = HashMap::new();
        once(&mut known, path, &lines)?;
        for path in loaded {
            let text = read(path)?;
            let (lines, leader, _) = body(&text);
            let lines = lines.get(leader..).unwrap_or_default();
            let is_named =
                |line: &&[u8]| matches!(line.trim_ascii_start().first(), Some(b'O' | b'o' | b':'));
            if !lines.iter().any(is_named) {
                return Err(Problem::trouble(
                    "load",
                    format_args!("{}: no O number says which program this is", name(path)),
                ));
            }
            once(&mut known, path, lines)?;
            files.push(JoinedFile {
                path: path.clone(),
                leader: leader as u64,
                lines: lines.len() as u64,
            });
            lines.iter().for_each(|line| put(line));
        }
        if closing {
            put(b"%");
        }
        program.joined = Some(Joined { text: all, files });
        Ok(program)
    }

    /// The file of the program itself.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file in which a refused line stands, and its line there.
    #[must_use]
    pub fn place(&self, refused: &RefusedLine) -> (&Path, RefusedLine) {
        let mut line = refused.line;
        for file in self.joined.iter().flat_map(|joined| &joined.files) {
            if line <= file.lines {
                let line = line + file.leader;
                return (&file.path, RefusedLine { line, ..*refused });
            }
            line -= file.lines;
        }
        (&self.path, *refused)
    }

    /// Reads the text piece by piece: of a single file the memory is that of one piece.
    pub(super) fn pieces(
        &self,
        mut take: impl FnMut(&[u8]) -> Result<(), Problem>,
    ) -> Result<(), Problem> {
        match &self.joined {
            Some(joined) => take(&joined.text),
            None => pieces(&self.path, take),
        }
    }
}

/// Notes the programs that begin on these lines; refuses one that there is already, as a control would take either.
fn once(known: &mut HashMap<String, PathBuf>, path: &Path, lines: &[&[u8]]) -> Result<(), Problem> {
    for begun in lines.iter().filter_map(|line| begins(line)) {
        if let Some(other) = known.insert(begun.clone(), path.to_owned()) {
            return Err(Problem::trouble(
                "load",
                format_args!(
                    "{begun} comes twice, in {} and in {}: load it once",
                    name(&other),
                    name(path)
                ),
            ));
        }
    }
    Ok(())
}

/// The program or subroutine that begins on this line: `O9010`, `:9010`, `o100 sub`, `o<name> sub`.
fn begins(line: &[u8]) -> Option<String> {
    let text = String::from_utf8_lossy(line).trim().to_lowercase();
    let rest = text.strip_prefix(['o', ':'])?.trim_start();
    if let Some(named) = rest.strip_prefix('<') {
        let (word, behind) = named.split_once('>')?;
        let is_sub = behind.trim_start().starts_with("sub");
        return is_sub.then(|| format!("o<{word}>"));
    }
    let end = rest
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(rest.len());
    let (digits, behind) = rest.split_at_checked(end)?;
    let number: u64 = digits.parse().ok()?;
    let behind = behind.trim_start();
    // Behind LinuxCNC's other O words stands what they do.
    let is_begin =
        behind.is_empty() || behind.starts_with(['(', ';', '<']) || behind.starts_with("sub");
    is_begin.then(|| format!("O{number:04}"))
}

/// The lines of a text up to its closing `%`, how many of them lead in, and whether there is a
/// closing one.
fn body(text: &[u8]) -> (Vec<&[u8]>, usize, bool) {
    let text = text.strip_suffix(b"\n").unwrap_or(text);
    let text = text.strip_suffix(b"\r").unwrap_or(text);
    let mut lines: Vec<&[u8]> = if text.contains(&b'\n') {
        let lines = text.split(|byte| *byte == b'\n');
        lines
            .map(|line| line.strip_suffix(b"\r").unwrap_or(line))
            .collect()
    } else {
        text.split(|byte| *byte == b'\r').collect()
    };
    let is_percent = |line: &&[u8]| line.trim_ascii_start().starts_with(b"%");
    let leader = lines.iter().position(is_percent).map_or(0, |at| at + 1);
    let rest = lines.get(leader..).unwrap_or_default();
    let closing = rest.iter().position(is_percent);
    if let Some(closing) = closing {
        lines.truncate(leader + closing);
    }
    (lines, leader, closing.is_some())
}

fn read(path: &Path) -> Result<Vec<u8>, Problem> {
    std::fs::read(path).map_err(|error| Problem::file("read", path, &error))
}

/// Reads a file piece by piece.
pub(super) fn pieces(
    path: &Path,
    mut take: impl FnMut(&[u8]) -> Result<(), Problem>,
) -> Result<(), Problem> {
    let fail = |error: io::Error| Problem::file("read", path, &error);
    let mut file = File::open(path).map_err(fail)?;
    let mut buffer = vec![0; PIECE];
    loop {
        let length = file.read(&mut buffer).map_err(fail)?;
        if length == 0 {
            return Ok(());
        }
        take(buffer.get(..length).unwrap_or_default())?;
    }
}
