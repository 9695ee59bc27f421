//! Errors between host and board.

use std::fmt;
use std::io;
use std::time::Duration;

use umi_protocol::access::AccessRefusal;
use umi_protocol::decoder::FrameCounters;
use umi_protocol::hello::Mismatch;

use crate::problem::Problem;

/// What went wrong between host and board, and what to do.
#[derive(Debug)]
#[non_exhaustive]
pub enum LinkError {
    /// The address is neither a path nor `tcp://host:port`.
    BadAddress {
        /// As given.
        address: String,
    },
    /// There is no such port.
    NoSuchPort {
        /// As given.
        address: String,
        /// The ports that there are.
        ports: Vec<String>,
    },
    /// The port is there and cannot be opened.
    CannotOpen {
        /// As given.
        address: String,
        /// What the system says.
        cause: io::Error,
    },
    /// Another program is the board's host; since when, where the port says it.
    Busy(String),
    /// The connection ended or failed.
    Closed(io::Error),
    /// No Hello came back.
    NobodyAnswers {
        /// How long was waited, all tries together.
        waited: Duration,
        /// What came instead.
        seen: FrameCounters,
        /// Our own Hello came back.
        echo: bool,
    },
    /// Board and host are of different versions.
    Mismatch {
        /// Who the board says that it is.
        board: String,
        /// What differs.
        mismatch: Mismatch,
    },
    /// The board speaks another schema than when it was greeted.
    BoardChanged,
    /// The answer to a request did not come.
    NoAnswer {
        /// The request.
        request: &'static str,
        /// How often it was sent.
        tries: u32,
        /// How long was waited, all tries together.
        waited: Duration,
    },
    /// Something came, but damaged.
    Damaged {
        /// The request.
        request: &'static str,
        /// How often it was sent.
        tries: u32,
        /// What came meanwhile.
        seen: FrameCounters,
    },
    /// No answer to a new job: whether the board took it is not known.
    JobOutcomeUnknown {
        /// How long was waited.
        waited: Duration,
    },
    /// The board could not read the request although the schema is the same.
    NotUnderstood {
        /// The request.
        request: &'static str,
    },
    /// The board answered what does not belong to the request, or what does not fit its
    /// own schema.
    WrongAnswer {
        /// The request.
        request: &'static str,
    },
    /// The board's journal storage failed.
    StorageFailed,
    /// The board has not kept what it was asked to, and keeps evidence until somebody acknowledges it.
    JournalFull,
    /// Its host may not ask for that.
    Refused(AccessRefusal),
    /// The board cannot have sessions.
    NoSessions,
    /// What answers does not prove the board's key.
    BoardNotProven,
}

impl LinkError {
    /// The stable name.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::BadAddress { .. } => "bad_address",
            Self::NoSuchPort { .. } => "no_such_port",
            Self::CannotOpen { .. } => "cannot_open",
            Self::Busy(_) => "busy",
            Self::Closed(_) => "connection_closed",
            Self::NobodyAnswers { .. } => "nobody_answers",
            Self::Mismatch { .. } => "version_mismatch",
            Self::BoardChanged => "board_changed",
            Self::NoAnswer { .. } => "no_answer",
            Self::Damaged { .. } => "damaged_answer",
            Self::JobOutcomeUnknown { .. } => "job_outcome_unknown",
            Self::NotUnderstood { .. } => "not_understood",
            Self::WrongAnswer { .. } => "wrong_answer",
            Self::StorageFailed => "storage_failed",
            Self::JournalFull => "journal_full",
            Self::Refused(refusal) => refusal.code(),
            Self::NoSessions => "not_on_this_board",
            Self::BoardNotProven => "board_not_proven",
        }
    }
}

impl fmt::Display for LinkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BadAddress { address } => write!(
                f,
                "`{address}` is no address of a board; give a port as /dev/ttyACM0 or COM3, or tcp://host:port"
            ),
            Self::NoSuchPort { address, ports } if ports.is_empty() => write!(
                f,
                "there is no port {address}, and no other serial port either; is the board connected and powered?"
            ),
            Self::NoSuchPort { address, ports } => write!(
                f,
                "there is no port {address}; ports here: {}",
                ports.join(", ")
            ),
            Self::CannotOpen { address, cause } => {
                write!(f, "cannot open {address}: {cause}")?;
                f.write_str(match cause.kind() {
                    io::ErrorKind::ConnectionRefused => "; is the virtual board running?",
                    io::ErrorKind::PermissionDenied => {
                        "; on Linux, serial ports are for members of the group that owns them (often `dialout`)"
                    }
                    _ => "; is another program using it?",
                })
            }
            Self::Busy(since) => write!(
                f,
                "the board is {since}: one program at a time can be its host; end that one first"
            ),
            Self::Closed(cause) if cause.kind() == io::ErrorKind::UnexpectedEof => {
                f.write_str("the board closed the connection; was it unplugged or restarted?")
            }
            Self::Closed(cause) => write!(
                f,
                "the connection to the board failed: {cause}; was it unplugged or restarted?"
            ),
            Self::NobodyAnswers {
                waited, echo: true, ..
            } => write!(
                f,
                "nobody answers ({waited:.1?}), only our own bytes come back: the port echoes or is looped; is it an openumi board?"
            ),
            Self::NobodyAnswers { waited, seen, .. } if seen.bytes_discarded == 0 => write!(
                f,
                "nobody answers ({waited:.1?}): is it an openumi board? is another program using the port?"
            ),
            Self::NobodyAnswers { waited, seen, .. } => {
                write!(f, "no intact answer in {waited:.1?}, but ")?;
                came(f, seen)?;
                f.write_str(": is it an openumi board? is it the board's host port, and not the one of the control?")
            }
            Self::Mismatch { board, mismatch } if board.is_empty() => mismatch.fmt(f),
            Self::Mismatch { board, mismatch } => write!(f, "{mismatch} (board: {board})"),
            Self::BoardChanged => f.write_str(
                "the board speaks another protocol than when the connection began: it was exchanged or updated; connect again",
            ),
            Self::NoAnswer {
                request,
                tries,
                waited,
            } => write!(
                f,
                "the board did not answer to `{request}` ({tries} tries, {waited:.1?}); it answered before: is it busy, or was it unplugged?"
            ),
            Self::Damaged {
                request,
                tries,
                seen,
            } => {
                write!(f, "no intact answer to `{request}` ({tries} tries): ")?;
                came(f, seen)?;
                f.write_str("; check cable, shield and earth")
            }
            Self::JobOutcomeUnknown { waited } => write!(
                f,
                "the board did not answer to the new job ({waited:.1?}): it is not known whether it took the job; read the job back before the next setup"
            ),
            Self::NotUnderstood { request } => write!(
                f,
                "the board could not read the request `{request}` although it speaks the same protocol: please report this fault"
            ),
            Self::WrongAnswer { request } => write!(
                f,
                "the board answered `{request}` with something else: please report this fault"
            ),
            Self::Refused(refusal) => refusal.fmt(f),
            Self::NoSessions => f.write_str("this board has no key of its own that can be read, and so no sessions. Where it had one, the jumper held over two starts has it wiped (`umi wipe --yes`), with a new key"),
            Self::BoardNotProven => f.write_str(
                "what answers there does not prove the key that it calls its own: somebody stands between this umi and the board",
            ),
            Self::JournalFull => f.write_str(
                "the board could not record it: its journal keeps evidence until somebody acknowledges it, and has no room for more. Pull it (umi log pull), acknowledge all of it (umi log ack), and try again. If that fails, too, its storage has failed: replace the board",
            ),
            Self::StorageFailed => f.write_str(
                "the board's journal storage failed; measurements are no longer recorded: replace the board",
            ),
        }
    }
}

/// What came that was no frame.
fn came(f: &mut fmt::Formatter<'_>, seen: &FrameCounters) -> fmt::Result {
    write!(f, "{} bytes came that are no frame", seen.bytes_discarded)?;
    if seen.crc_errors > 0 {
        write!(f, ", {} checksum errors", seen.crc_errors)?;
    }
    Ok(())
}

impl std::error::Error for LinkError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::CannotOpen { cause, .. } | Self::Closed(cause) => Some(cause),
            Self::Mismatch { mismatch, .. } => Some(mismatch),
            _ => None,
        }
    }
}

impl From<LinkError> for Problem {
    fn from(error: LinkError) -> Self {
        let LinkError::Refused(refusal) = error else {
            return Self::trouble(error.code(), error);
        };
        let problem = Self::refused(refusal.code(), refusal);
        match refusal {
            AccessRefusal::KeyNeeded { needs } => problem.with("needs", needs.name()),
            AccessRefusal::RoleTooLow { needs, has } => {
                problem.with("needs", needs.name()).with("has", has.name())
            }
            AccessRefusal::TooManyTries { retry_in_s } => problem.with("retry_in_s", retry_in_s),
            _ => problem,
        }
    }
}
