//! Programs that the control punches, on their way into the flash.
//!
//! # Design
//!
//! The receiver tells a program's lines from printed ones; what of it comes with one input is
//! collected here and then written at once, while nothing else is. Flash that is erased for
//! half a second keeps the state locked: what the control sends meanwhile waits in the intake.
//!
//! It is kept as the receiver understands it: without parity, blanks of the tape and control
//! codes, lines ended by LF, from `%` to `%`. So its check value is the same whatever code
//! the control punches in. One character that is damaged or lost, or a port that is closed
//! before the last `%`, and nothing of it is kept, which is told: the control still has it.
//! What comes by XMODEM is kept byte for byte, if it ends with `%`: a character of noise may
//! mean "end" there.
//!
//! # Limitations
//!
//! Programs with a number only (`O1234`, `:1234`), on their first line that is no comment; of
//! others the journal has the bytes. Several between one pair of `%` are kept as one, under the
//! first number. By XMODEM that line has to end within the first block.
//! Without a job nothing is kept: no receiver reads the lines.

use heapless::Vec;
use umi_core::journal::Flash;
use umi_core::programs::{Store, StoreError};
use umi_protocol::fault::FaultKind;
use umi_protocol::job::{Name, name};
use umi_protocol::line::{LineReport, LineStatus};
use umi_protocol::program::{ProgramInfo, ProgramRefusal};

/// What one input completes: a line that waited, and as many as its own bytes make.
const TEXT: usize = 512;

/// What became of a program.
pub(crate) enum UploadEnd {
    /// It is kept, or was there already.
    Kept(ProgramInfo),
    /// It is not.
    Refused(u32, ProgramRefusal),
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    None,
    /// Its first line has come.
    Begins,
    /// The flash has what came before.
    Goes,
    /// It is whole.
    Ends,
    /// It is not kept; more of it may come.
    Breaks,
    /// It is not kept, and it is over.
    Broken,
    /// It is not kept, and that has been told; more of it may come.
    Told,
}

/// Whether the host wants a program by XMODEM.
#[derive(Clone, Copy, PartialEq, Eq)]
enum UploadRequest {
    Nothing,
    /// The control has not been asked yet.
    Asked,
    /// It has.
    Waits,
    /// It sends.
    Comes,
}

/// A program that is being punched.
pub(crate) struct ProgramUpload {
    state: State,
    number: u32,
    name: Name,
    text: Vec<u8, TEXT>,
    /// Its line that came last begins with `%`.
    is_closed: bool,
    wants: UploadRequest,
    block: Block,
    /// It begins a program.
    begins: bool,
    /// The byte of it that is no blank and came last.
    last: u8,
}

/// A block of XMODEM on its way into the flash.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Block {
    None,
    Waits,
    WaitsAsLast,
    Stored,
    /// The last one, and the program counts.
    Kept,
    Refused,
}

impl ProgramUpload {
    /// None.
    pub const fn new() -> Self {
        Self {
            state: State::None,
            number: 0,
            name: Name::new(),
            text: Vec::new(),
            is_closed: false,
            wants: UploadRequest::Nothing,
            block: Block::None,
            begins: false,
            last: 0,
        }
    }

    /// The host wants a program by XMODEM.
    pub fn ask(&mut self) {
        self.wants = UploadRequest::Asked;
        self.number = 0;
    }

    /// Whether it does; once.
    pub fn asked(&mut self) -> bool {
        let is_asked = self.wants == UploadRequest::Asked;
        if is_asked {
            self.wants = UploadRequest::Waits;
        }
        is_asked
    }

    /// Whether a program is under way, or waited for.
    pub fn is_busy(&self) -> bool {
        self.state != State::None || self.wants != UploadRequest::Nothing
    }

    /// The host is gone. Whether the control is asked for what nobody waits for: what has
    /// begun to come is kept all the same.
    pub fn host_gone(&mut self) -> bool {
        if self.wants == UploadRequest::Asked {
            self.wants = UploadRequest::Nothing;
        }
        self.wants == UploadRequest::Waits
    }

    /// The next bytes by XMODEM; the first ones begin a program.
    pub fn block(&mut self, bytes: &[u8], is_first: bool, is_last: bool) {
        if is_first {
            let lines = bytes.split_inclusive(|byte| matches!(byte, b'\r' | b'\n'));
            let mut lines = lines.map(|line| (line, text(line)));
            let found = lines.find(|(_, text)| says_number(text));
            let (line, text) = found.unwrap_or_default();
            // A line that goes on in the next block may have more digits.
            let is_whole = matches!(line.last(), Some(b'\r' | b'\n')) || is_last;
            let (number, title) = number_and_title(text);
            self.number = if is_whole { number } else { 0 };
            self.name = name(title);
            self.last = 0;
            self.wants = UploadRequest::Comes;
        }
        self.begins = is_first;
        self.text.clear();
        // A block has as many bytes as there is room for, and fewer.
        let _ = self.text.extend_from_slice(bytes);
        let blank = |byte: &u8| *byte == 0 || byte.is_ascii_whitespace();
        if let Some(last) = bytes.iter().rfind(|byte| !blank(byte)) {
            self.last = *last;
        }
        self.block = match is_last {
            true => Block::WaitsAsLast,
            false => Block::Waits,
        };
    }

    /// Whether a block waits.
    pub fn has_block(&self) -> bool {
        matches!(self.block, Block::Waits | Block::WaitsAsLast)
    }

    /// Whether the block is in the flash; none: it waits yet.
    pub fn stored(&mut self) -> Option<bool> {
        match self.block {
            Block::Waits | Block::WaitsAsLast => None,
            block => Some(block != Block::Refused),
        }
    }

    /// Writes a block; what became of the program, if it has ended.
    pub fn store_block<F: Flash>(&mut self, store: Option<&mut Store<F>>) -> Option<UploadEnd> {
        let (number, is_last) = (self.number, self.block == Block::WaitsAsLast);
        let done = match store {
            None => Err(ProgramRefusal::NoRoomAtAll),
            Some(store) => self.write_block(store, is_last).map_err(|error| {
                store.give_up_open();
                refusal(&error)
            }),
        };
        self.text.clear();
        self.block = match done {
            Ok(Some(_)) => Block::Kept,
            Ok(None) => Block::Stored,
            Err(_) => Block::Refused,
        };
        match done {
            Ok(info) => info.map(UploadEnd::Kept),
            Err(why) => Some(UploadEnd::Refused(number, why)),
        }
    }

    fn write_block<F: Flash>(
        &mut self,
        store: &mut Store<F>,
        is_last: bool,
    ) -> Result<Option<ProgramInfo>, StoreError<F::Error>> {
        if self.begins {
            store.begin_open()?;
        }
        if !self.text.is_empty() {
            store.append(&self.text)?;
        }
        if !is_last {
            return Ok(None);
        }
        if self.last != b'%' {
            return Err(ProgramRefusal::BrokeOff.into());
        }
        self.end(store).map(Some)
    }

    /// Receiving by XMODEM has ended; the number of what is not kept, if there was no end.
    pub fn end_blocks<F: Flash>(
        &mut self,
        store: Option<&mut Store<F>>,
        is_whole: bool,
    ) -> Option<u32> {
        let said = matches!(self.block, Block::Kept | Block::Refused);
        self.block = Block::None;
        self.wants = UploadRequest::Nothing;
        if is_whole || said {
            return None;
        }
        if let Some(store) = store {
            store.give_up_open();
        }
        Some(core::mem::take(&mut self.number))
    }

    /// A line has come.
    pub fn line(&mut self, line: &LineReport) {
        match (line.status, self.state) {
            (LineStatus::Program, State::None) => {
                self.state = State::Begins;
                self.number = 0;
                self.name = Name::new();
                self.text.clear();
                self.put("%");
                self.add(&line.text);
            }
            (LineStatus::Program, State::Begins | State::Goes) => self.add(&line.text),
            (LineStatus::Damaged, State::Begins | State::Goes) => self.breaks(),
            _ => {}
        }
    }

    /// Something was noticed.
    pub fn fault(&mut self, kind: &FaultKind) {
        match kind {
            FaultKind::ProgramReceived { .. } if self.is_closed => self.over(true),
            FaultKind::ProgramReceived { .. } | FaultKind::ProgramUnterminated { .. } => {
                self.over(false);
            }
            _ => {}
        }
    }

    /// No more of it comes, or what comes is not known as a part of it.
    pub fn over(&mut self, is_whole: bool) {
        self.state = match self.state {
            State::None | State::Told => State::None,
            State::Begins | State::Goes if is_whole => State::Ends,
            _ => State::Broken,
        };
    }

    /// Bytes are missing.
    pub fn breaks(&mut self) {
        if matches!(self.state, State::Begins | State::Goes) {
            self.state = State::Breaks;
        }
    }

    fn add(&mut self, line: &str) {
        if self.number == 0 && says_number(line) {
            let (number, title) = number_and_title(line);
            self.number = number;
            self.name = name(title);
            if number == 0 {
                self.breaks();
            }
        }
        self.is_closed = line.trim_start().starts_with('%');
        self.put(line);
    }

    fn put(&mut self, line: &str) {
        let whole = self.text.extend_from_slice(line.as_bytes()).is_ok();
        if !(whole && self.text.push(b'\n').is_ok()) {
            self.breaks();
        }
    }

    /// Whether there is something to do.
    pub fn waits(&self) -> bool {
        !matches!(self.state, State::None | State::Told)
    }

    /// Whether there is, before anything else is looked at: another may begin.
    pub fn is_over(&self) -> bool {
        matches!(self.state, State::Ends | State::Broken)
    }

    /// Writes what has come; what became of the program, if it has ended.
    pub fn store<F: Flash>(&mut self, store: Option<&mut Store<F>>) -> Option<UploadEnd> {
        let number = self.number;
        let Some(store) = store else {
            self.told();
            return Some(UploadEnd::Refused(number, ProgramRefusal::NoRoomAtAll));
        };
        match self.state {
            State::Breaks => {
                store.give_up_open();
                return None;
            }
            State::Broken => {
                store.give_up_open();
                self.told();
                let why = match number {
                    0 => ProgramRefusal::BadNumber,
                    _ => ProgramRefusal::BrokeOff,
                };
                return Some(UploadEnd::Refused(number, why));
            }
            _ => {}
        }
        let done = self.write(store);
        self.text.clear();
        match done {
            Ok(None) => None,
            Ok(Some(info)) => {
                self.state = State::None;
                Some(UploadEnd::Kept(info))
            }
            Err(error) => {
                store.give_up_open();
                self.told();
                Some(UploadEnd::Refused(number, refusal(&error)))
            }
        }
    }

    fn told(&mut self) {
        self.state = match self.is_over() {
            true => State::None,
            false => State::Told,
        };
    }

    /// The program, when it is there.
    fn write<F: Flash>(
        &mut self,
        store: &mut Store<F>,
    ) -> Result<Option<ProgramInfo>, StoreError<F::Error>> {
        if !store.is_punched() {
            store.begin_open()?;
        }
        store.append(&self.text)?;
        if self.state != State::Ends {
            self.state = State::Goes;
            return Ok(None);
        }
        self.end(store).map(Some)
    }

    fn end<F: Flash>(&self, store: &mut Store<F>) -> Result<ProgramInfo, StoreError<F::Error>> {
        store.end_open(self.number, self.name.clone())?;
        let program = store.find(self.number).ok_or(ProgramRefusal::NotThere)?;
        store.info(&program)
    }
}

fn refusal<E>(error: &StoreError<E>) -> ProgramRefusal {
    match error {
        StoreError::Refused(refusal) => *refusal,
        // Its memory does not answer.
        StoreError::Flash(_) | StoreError::NotKept { .. } | StoreError::Geometry(_) => {
            ProgramRefusal::NoRoomAtAll
        }
    }
}

/// What can be read of a line: comments may be in any code.
fn text(line: &[u8]) -> &str {
    line.utf8_chunks().next().map_or("", |chunk| chunk.valid())
}

/// Whether a program's number has to be on this line: it is no comment.
fn says_number(line: &str) -> bool {
    !matches!(line.trim_start().bytes().next(), None | Some(b'%' | b'('))
}

/// The number of `O1234(NAME)` and what stands behind it; 0 if it has none.
fn number_and_title(line: &str) -> (u32, &str) {
    let text = line.trim();
    let Some(digits) = text.strip_prefix(['O', ':']) else {
        return (0, "");
    };
    let end = digits
        .bytes()
        .position(|byte| !byte.is_ascii_digit())
        .unwrap_or(digits.len());
    let (digits, title) = digits.split_at_checked(end).unwrap_or((digits, ""));
    let title = title.trim().trim_start_matches('(').trim_end_matches(')');
    (digits.parse().unwrap_or(0), title.trim())
}

#[cfg(test)]
mod tests {
    use super::number_and_title;

    /// Numbers and titles of first lines.
    #[test]
    fn first_lines() {
        for (line, number, title) in [
            ("O1234", 1234, ""),
            ("O0007(POCKET)", 7, "POCKET"),
            (" :0001 (A B) ", 1, "A B"),
            ("%1234", 0, ""),
            ("O", 0, ""),
            ("N10 G0 X1.", 0, ""),
        ] {
            assert_eq!(number_and_title(line), (number, title), "{line}");
        }
    }
}
