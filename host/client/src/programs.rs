//! Part programs to a board and back: in pieces, with what a line may lose asked for again,
//! and check values at the end.

use std::thread::sleep;
use std::time::{Duration, Instant};

use umi_core::rewrite::Check;
use umi_protocol::message::Record;
use umi_protocol::program::{MAX_PIECE, Piece, ProgramInfo, ProgramRefusal, ProgramRoom};
use umi_protocol::serial::LineSettings;

use crate::board::link::{Client, LinkError};
use crate::journal::{self, PullRequest, PullStep};
use crate::problem::Problem;

/// How long a board may be busy with a setup before an upload gives up. It can be taken up
/// again where it was.
const PATIENCE: Duration = Duration::from_secs(60);
/// How often a busy board is asked.
const AGAIN: Duration = Duration::from_millis(200);
/// How long a control may take to send a program: 1.7 MB at 4800 baud, and on a slower line
/// longer for as many.
const RECEIVING: Duration = Duration::from_secs(3600);
const RECEIVING_BAUD: u32 = 4800;
/// What 115200 baud take to make room for more: half of what the board holds.
const LINE: Duration = Duration::from_millis(10);

/// The check value of a program's bytes.
#[must_use]
pub fn check_value(bytes: &[u8]) -> u32 {
    let mut check = Check::default();
    check.update(bytes);
    check.finish().crc32
}

/// The O-number that a program says of itself, on its first line with words.
#[must_use]
pub fn number_in(program: &[u8]) -> Option<u32> {
    let text = program
        .split(|byte| matches!(byte, b'\n' | b'\r'))
        .map(<[u8]>::trim_ascii)
        .find(|line| !matches!(line.first(), None | Some(b'%' | b'(')))?;
    let digits = match text.split_first()? {
        (b'O' | b'o' | b':', rest) => rest,
        _ => return None,
    };
    let end = digits
        .iter()
        .position(|byte| !byte.is_ascii_digit())
        .unwrap_or(digits.len());
    std::str::from_utf8(digits.get(..end)?).ok()?.parse().ok()
}

/// Whether a program stands between two `%`, as a board wants it, blank tape around them. One
/// that was cut off does not.
#[must_use]
pub fn is_closed(program: &[u8]) -> bool {
    let is_blank = |byte: &u8| matches!(byte, 0 | b' ' | b'\t' | b'\r' | b'\n');
    let text = || program.iter().filter(|byte| !is_blank(byte));
    [text().next(), text().next_back()] == [Some(&b'%'); 2] && text().count() > 1
}

/// All programs on a board, by number, and how much room there is.
///
/// # Errors
/// The link's; the board's refusal.
pub fn list(board: &mut Client) -> Result<(ProgramRoom, Vec<ProgramInfo>), Problem> {
    let mut all = Vec::new();
    loop {
        let skip = u16::try_from(all.len()).unwrap_or(u16::MAX);
        let (room, some) = board.programs(skip)?.map_err(|of| refusal(&of))?;
        if some.is_empty() {
            all.sort_by_key(|program: &ProgramInfo| program.number);
            return Ok((room, all));
        }
        all.extend(some);
    }
}

/// Uploads a program; `progress` is told how many bytes are there, first how many were
/// already. The old program of the number stays until all is there.
///
/// # Errors
/// The link's; the board's refusal. Either way it can be called again and goes on.
pub fn put(
    board: &mut Client,
    program: &ProgramInfo,
    bytes: &[u8],
    mut progress: impl FnMut(u32),
) -> Result<(), Problem> {
    let mut offset = patiently(board, |board| board.program_begin(program))?;
    progress(offset);
    while offset < program.bytes {
        let rest = bytes.get(offset as usize..).unwrap_or_default();
        let piece: Piece = rest.iter().copied().take(MAX_PIECE).collect();
        offset = patiently(board, |board| board.program_piece(offset, piece.clone()))?;
        progress(offset);
    }
    patiently(board, |board| {
        board.program_end(program.number, program.crc32)
    })
}

/// Reads a program; `progress` is told how many bytes came. Its check value is right.
///
/// # Errors
/// The link's; the board's refusal; `program_damaged`.
pub fn get(
    board: &mut Client,
    program: &ProgramInfo,
    mut progress: impl FnMut(u32),
) -> Result<Vec<u8>, Problem> {
    let mut bytes = Vec::new();
    while bytes.len() < program.bytes as usize {
        let offset = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
        let piece = board.program_read(program.number, offset)?;
        let piece = piece.map_err(|of| refusal(&of))?;
        if piece.is_empty() {
            break;
        }
        bytes.extend(piece);
        progress(u32::try_from(bytes.len()).unwrap_or(u32::MAX));
    }
    let crc32 = check_value(&bytes);
    if crc32 != program.crc32 {
        return Err(refusal(&ProgramRefusal::Damaged { crc32 }));
    }
    Ok(bytes)
}

/// Deletes a program.
///
/// # Errors
/// The link's; the board's refusal.
pub fn delete(board: &mut Client, number: u32) -> Result<(), Problem> {
    patiently(board, |board| board.program_delete(number))
}

/// Passes a program through to the control: its next READ gets it, as the bytes come.
/// `progress` is told how many bytes the board has taken; what breaks off begins anew.
///
/// # Errors
/// The link's; the board's refusal. When this process ends, so does what the control gets.
pub fn pass(
    board: &mut Client,
    program: &ProgramInfo,
    bytes: &[u8],
    mut progress: impl FnMut(u32),
) -> Result<(), Problem> {
    let mut offset = patiently(board, |board| board.program_pass(program))?;
    loop {
        progress(offset);
        let rest = bytes.get(offset as usize..).unwrap_or_default();
        let piece: Piece = rest.iter().copied().take(MAX_PIECE).collect();
        let taken = board.program_passed(offset, piece)?;
        let Some(next) = taken.map_err(|of| refusal(&of))? else {
            return Ok(());
        };
        if next == offset {
            // The control has not read yet, or the line is slower than we are.
            sleep(LINE);
        }
        offset = next;
    }
}

/// Lets the board ask the control for a program by XMODEM, and waits for what becomes of it.
///
/// # Errors
/// The link's; the board's refusal, `program_broke_off` among them.
pub fn receive(board: &mut Client) -> Result<ProgramInfo, Problem> {
    let mut next = board.journal_info()?.next_seq;
    let job = board.job()?.job;
    let baud = job
        .map_or(LineSettings::DEFAULT, |job| job.line.settings())
        .baud;
    patiently(board, Client::program_receive)?;
    let slower = RECEIVING_BAUD.div_ceil(baud.max(1));
    let give_up = Instant::now() + RECEIVING * slower.max(1);
    while Instant::now() < give_up {
        let mut end = None;
        let wanted = PullRequest {
            from: Some(next),
            ..PullRequest::default()
        };
        let pulled = journal::pull(board, wanted, |step| {
            if let PullStep::Entry(entry, _) = step {
                match journal::record(&entry) {
                    Ok(Record::ProgramKept { program, .. }) => end = Some(Ok(program)),
                    Ok(Record::ProgramNotKept { why, .. }) => end = Some(Err(refusal(&why))),
                    // It says nothing of this.
                    _ => {}
                }
            }
            Ok::<(), Problem>(())
        })?;
        if let Some(end) = end {
            return end;
        }
        next = pulled.stretch.next;
        sleep(AGAIN);
    }
    Err(refusal(&ProgramRefusal::BrokeOff))
}

/// Makes a program what the control's next READ gets.
///
/// # Errors
/// The link's; the board's refusal.
pub fn offer(board: &mut Client, number: u32) -> Result<(), Problem> {
    patiently(board, |board| board.program_offer(number))
}

/// Asks again as long as the board is busy.
fn patiently<T>(
    board: &mut Client,
    mut ask: impl FnMut(&mut Client) -> Result<Result<T, ProgramRefusal>, LinkError>,
) -> Result<T, Problem> {
    let give_up = Instant::now() + PATIENCE;
    loop {
        match ask(board)? {
            Ok(answer) => return Ok(answer),
            Err(ProgramRefusal::Busy) if Instant::now() < give_up => sleep(AGAIN),
            Err(of) => return Err(refusal(&of)),
        }
    }
}

/// A refusal, with its figures for machines.
#[must_use]
pub fn refusal(of: &ProgramRefusal) -> Problem {
    let explained = Problem::refused(of.code(), of);
    match *of {
        ProgramRefusal::Full {
            needed_bytes,
            longest_bytes,
            free_bytes,
        } => explained
            .with("needed_bytes", needed_bytes)
            .with("longest_bytes", longest_bytes)
            .with("free_bytes", free_bytes),
        ProgramRefusal::TooMany { most } => explained.with("most", most),
        ProgramRefusal::Incomplete { offset } => explained.with("offset", offset),
        ProgramRefusal::Damaged { crc32 } | ProgramRefusal::OtherThere { crc32 } => {
            explained.with("crc32", crc32)
        }
        _ => explained,
    }
}

#[cfg(test)]
mod tests {
    use super::{is_closed, number_in};

    #[test]
    fn a_program_stands_between_percents() {
        for (text, closed) in [
            ("%\nO1\nM30\n%\n", true),
            ("\r\n%O1\r\nM30\r\n%\r\n\0\0", true),
            ("%\nO1\nM30\n", false),
            ("O1\nM30\n%", false),
            ("\u{feff}%\nO1\n%", false),
            ("%\n", false),
            ("", false),
        ] {
            assert_eq!(is_closed(text.as_bytes()), closed, "{text:?}");
        }
    }

    #[test]
    fn a_program_says_its_number() {
        for (text, number) in [
            ("%\nO1234(POCKET)\nG21\n", Some(1234)),
            ("\r\n%\r\n (BY CAM)\r\no0007\r\n", Some(7)),
            ("%\n:0042\nG21\n", Some(42)),
            ("G21\nO1234\n", None),
            ("O\n", None),
            ("", None),
        ] {
            assert_eq!(number_in(text.as_bytes()), number, "{text:?}");
        }
    }
}
