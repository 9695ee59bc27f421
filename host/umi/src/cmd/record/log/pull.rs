//! `umi log pull`: a board's journal as a file, with the head that the board signs at its end.

use std::fs::File;
use std::io::{self, BufWriter, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use umi_client::board::link::Client;
use umi_client::journal::verify::{VerifiedFile, other_key, verify};
use umi_client::journal::{self, Begun, PullRequest, PullStep, Unsigned, key_id};
use umi_client::problem::Problem;
use umi_core::journal::{FILE_HEADER_SIZE, decode_file};
use umi_protocol::head::HeadAnswer;

use super::{Board, Format, sum_up};
use crate::failure::Failure;
use crate::output::Force;
use crate::show::terminal::{CAUTION, paint, print_error};

/// Pull the journal of a board into a file, or go on where that broke off
#[derive(Args)]
#[command(after_help = "\
The board signs the end of the file over a number that nobody knew before, as soon as no
clamping is under way. A pull that broke off goes on from what is in FILE.part. Entries that the
board overwrites meanwhile are named in the file and in what is printed. A board whose memory is damaged
has not all that it has signed for: the file is kept, as FILE.damaged where FILE is there already.

Examples:
  umi log pull monday.umij --port /dev/ttyACM0
  umi log pull monday.umij --from 1200 --force")]
pub(super) struct PullFile {
    /// The file
    #[arg(value_name = "FILE.umij")]
    file: PathBuf,
    /// Begin with this entry instead of the oldest
    #[arg(long, value_name = "SEQ")]
    from: Option<u64>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    board: Board,
    #[command(flatten)]
    format: Format,
}

impl PullFile {
    pub fn run(self) -> Result<(), Failure> {
        self.force.check(&self.file, &[])?;
        let pull = Pull {
            file: &self.file,
            from: self.from,
            goes_on: !self.force.is_given(),
        };
        let mut board = self.board.connect()?;
        board.host_time(crate::show::utc::now_utc_s())?;
        let verified = pull.run(&mut board)?;
        sum_up(self.format.json, &verified, Some(&self.file), true)
    }
}

/// What is pulled where.
pub(super) struct Pull<'a> {
    pub file: &'a Path,
    pub from: Option<u64>,
    /// What an earlier pull has left is gone on with. Whether `file` may be replaced has been
    /// asked before.
    pub goes_on: bool,
}

impl Pull<'_> {
    pub fn run(&self, board: &mut Client) -> Result<VerifiedFile, Failure> {
        let path = self.file;
        // What takes its place when it is complete would take that of a device, too.
        if path.metadata().is_ok_and(|found| !found.is_file()) {
            let message = format_args!("{} is no file: give another name", path.display());
            return Err(Failure::trouble("file", message));
        }
        // Under its own name only when it is complete.
        let part = with_suffix(path, ".part");
        let failed = |error| Failure::file("write", &part, &error);
        // What an earlier pull has left is gone on with only if it is this board's as well.
        let key = self
            .goes_on
            .then(|| board_key(board))
            .transpose()?
            .flatten();
        let (file, begun) = self.begin(&part, key).map_err(failed)?;
        let mut file = BufWriter::new(file);
        let bar = ProgressBar::no_length().with_style(style());
        let wanted = PullRequest {
            from: self.from,
            begun,
            head: true,
        };
        let pulled = journal::pull(board, wanted, |step| match step {
            PullStep::Header(header, next) => {
                bar.set_length(next - header.first_seq);
                match begun {
                    Some(begun) => bar.set_position(begun.next - header.first_seq),
                    None => file.write_all(&header.encode()).map_err(failed)?,
                }
                Ok(())
            }
            PullStep::Gap(gap) => {
                bar.inc(gap.next - gap.first);
                file.write_all(&gap.encode()).map_err(failed)
            }
            PullStep::Entry(_, raw) => {
                bar.inc(1);
                file.write_all(raw).map_err(failed)
            }
        });
        bar.finish_and_clear();
        let closed = file
            .into_inner()
            .map_err(|error| failed(error.into_error()));
        let pulled = pulled.map_err(|failure| kept(failure, &part))?;
        let mut file = closed?;
        file.seek(SeekFrom::Start(0)).map_err(failed)?;
        file.write_all(&pulled.header.encode()).map_err(failed)?;
        file.sync_all().map_err(failed)?;
        // What is in the file is what is told of it.
        let bytes = std::fs::read(&part).map_err(failed)?;
        let named = |path: &Path| {
            std::fs::rename(&part, path).map_err(|error| Failure::file("write", path, &error))
        };
        // Before anything is named: what is another board's takes no place.
        if let Some(proven) = board.proven_board()
            && let Some(key) = other_key(&bytes, proven)
        {
            return Err(Failure::refused(
                "head_other_board",
                format_args!(
                    "the heads are signed by key {}, and the board has proven that it is {}",
                    key_id(&key),
                    key_id(proven)
                ),
            ));
        }
        let verified = match verify(&bytes, None, None) {
            // The board has not all that it has signed for: nobody will get more of it.
            Err(problem) if problem.code == "head_signature" => {
                let kept = place_of_damaged(path);
                named(&kept)?;
                let message = format!(
                    "{problem}; all that the board has is in {}: keep it",
                    kept.display()
                );
                return Err(Problem { message, ..problem }.into());
            }
            verified => verified?,
        };
        named(path)?;
        if pulled.unsigned == Some(Unsigned::Busy) {
            let text = "the board has not signed the end of the file: a clamping is under way, many ask it for heads, or it overwrites its entries faster than they can be read; pull it again later";
            print_error(&format!("{} {text}\n", paint(CAUTION, "note:")));
        }
        if pulled.unsigned == Some(Unsigned::Full) {
            let text = format!(
                "the end of the file is not signed: the board's journal has no room for a signature until somebody acknowledges what it holds, or a clamping is under way. Keep the file, say so (umi log ack {}), and pull again",
                verified.stretch.next
            );
            print_error(&format!("{} {text}\n", paint(CAUTION, "note:")));
        }
        if pulled.unsigned == Some(Unsigned::Overtaken) {
            let text = "the file is not signed as a whole: the board overwrote entries while they were read, and no head vouches for those right before; pull it again";
            print_error(&format!("{} {text}\n", paint(CAUTION, "note:")));
        }
        Ok(verified)
    }

    /// The file, and what of it is there already.
    fn begin(&self, part: &Path, key: Option<[u8; 32]>) -> io::Result<(File, Option<Begun>)> {
        if self.goes_on
            && let Some(found) = self.found(part, key)?
        {
            return Ok(found);
        }
        // A link that somebody has put under its name is taken away, not followed.
        match std::fs::remove_file(part) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok((File::create_new(part)?, None)),
        }
    }

    fn found(
        &self,
        part: &Path,
        key: Option<[u8; 32]>,
    ) -> io::Result<Option<(File, Option<Begun>)>> {
        // Not a link.
        if !part.symlink_metadata().is_ok_and(|found| found.is_file()) {
            return Ok(None);
        }
        let bytes = std::fs::read(part)?;
        let Ok((header, mut entries)) = decode_file(&bytes) else {
            return Ok(None);
        };
        let is_other = self.from.is_some_and(|from| from != header.first_seq);
        if is_other || !bytes.starts_with(&header.encode()) {
            return Ok(None);
        }
        while let Some(Ok(_)) = entries.next() {}
        // Cut where its last entry ends, its heads are good ones, and the board's.
        let whole = bytes.get(..FILE_HEADER_SIZE + entries.offset());
        let good = whole.and_then(|whole| verify(whole, None, None).ok());
        if !good.is_some_and(|good| good.key.is_none() || good.key == key) {
            return Ok(None);
        }
        let begun = Begun {
            header,
            next: entries.next_seq(),
            chain: entries.chain_head(),
        };
        let mut file = File::options().write(true).open(part)?;
        let whole = (FILE_HEADER_SIZE + entries.offset()) as u64;
        file.set_len(whole)?;
        file.seek(SeekFrom::Start(whole))?;
        Ok(Some((file, Some(begun))))
    }
}

/// Where a file goes that is not all that the board has signed for: it takes the place of none that may be whole.
fn place_of_damaged(path: &Path) -> PathBuf {
    if path.exists() {
        with_suffix(path, ".damaged")
    } else {
        path.to_owned()
    }
}

fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

/// The key by which the board signs; none: it has none, or cannot sign now.
fn board_key(board: &mut Client) -> Result<Option<[u8; 32]>, Failure> {
    if let Some(proven) = board.proven_board() {
        return Ok(Some(*proven));
    }
    Ok(match board.head(None)? {
        HeadAnswer::Signed(head) => Some(head.key),
        HeadAnswer::NoKey | HeadAnswer::Pending => None,
    })
}

/// Says where that is which came before the failure.
fn kept(failure: Failure, part: &Path) -> Failure {
    let part = part.display();
    failure.noted(&format!(
        "\nwhat came before stays in {part}, and the next pull goes on from it; --force begins anew"
    ))
}

fn style() -> ProgressStyle {
    ProgressStyle::with_template("{bar:40} {pos}/{len} entries, {per_sec}, {eta} left")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
}

#[cfg(test)]
mod tests {
    use super::place_of_damaged;

    /// An older file, which may be whole, stays where it is, also with `--force`.
    #[test]
    fn a_damaged_file_replaces_none() {
        let here = std::env::current_exe().unwrap();
        assert!(
            place_of_damaged(&here)
                .to_str()
                .unwrap()
                .ends_with(".damaged")
        );
        let free = here.with_file_name("no such file.umij");
        assert_eq!(place_of_damaged(&free), free);
    }
}
