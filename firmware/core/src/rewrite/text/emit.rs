//! The text of a block with some words changed, every other byte as it was.

use heapless::Vec;

use super::length::{DECIMAL, decimal};
use super::words::{Number, Word, Words};

/// Words of a block that change, at most: each letter that has a place or a way stands there
/// once, and a motion or a cycle, and F.
const MAX_CHANGED: usize = 16;

/// What becomes of a word.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::rewrite) enum Action {
    Keep,
    /// The same letter with another length: steps, decimals.
    Length(i64, u8),
    /// Another word in its place.
    Text(&'static [u8]),
    Drop,
}

/// What becomes of a block.
#[derive(Clone, Debug, Default)]
pub(in crate::rewrite) struct Edit {
    /// The words that change, by their index; all others are kept.
    changed: Vec<(u8, Action), MAX_CHANGED>,
    /// A bit for each word that is in there.
    is_changed: u64,
    /// Words that were not there: letter, steps, decimals.
    added: Vec<(u8, i64, u8), 8>,
    /// A G code before the first word that a motion takes.
    code: Option<&'static [u8]>,
}

impl Edit {
    pub fn set(&mut self, word: usize, action: Action) {
        // At most MAX_WORDS.
        let index = word as u8;
        if self.changes(word) {
            let slot = self.changed.iter_mut().find(|(other, _)| *other == index);
            if let Some((_, slot)) = slot {
                *slot = action;
            }
        } else if self.changed.push((index, action)).is_ok() {
            self.is_changed |= bit(word);
        }
    }

    pub fn add(&mut self, letter: u8, steps: i64, decimals: u8) {
        // Three axes, two centres, a feed: there is room.
        let _ = self.added.push((letter, steps, decimals));
    }

    pub fn code(&mut self, code: &'static [u8]) {
        self.code = Some(code);
    }

    const fn changes(&self, word: usize) -> bool {
        self.is_changed & bit(word) != 0
    }

    fn action(&self, word: usize) -> Action {
        if !self.changes(word) {
            return Action::Keep;
        }
        let index = word as u8;
        let mut changed = self.changed.iter();
        let found = changed.find(|(other, _)| *other == index);
        found.map_or(Action::Keep, |(_, action)| *action)
    }
}

/// The bit of a word: there are 48 at most.
const fn bit(word: usize) -> u64 {
    1_u64.wrapping_shl(word as u32)
}

/// Collects output and hands it on in pieces.
pub(in crate::rewrite) struct Out<'a, S: FnMut(&[u8])> {
    sink: &'a mut S,
    held: [u8; 256],
    length: usize,
}

impl<'a, S: FnMut(&[u8])> Out<'a, S> {
    pub fn new(sink: &'a mut S) -> Self {
        Self {
            sink,
            held: [0; 256],
            length: 0,
        }
    }

    #[inline]
    pub fn put(&mut self, bytes: &[u8]) {
        let end = self.length.saturating_add(bytes.len());
        if let Some(room) = self.held.get_mut(self.length..end) {
            room.copy_from_slice(bytes);
            self.length = end;
        } else {
            self.flush();
            if bytes.len() > self.held.len() / 2 {
                (self.sink)(bytes);
            } else if let Some(room) = self.held.get_mut(..bytes.len()) {
                room.copy_from_slice(bytes);
                self.length = bytes.len();
            }
        }
    }

    pub fn flush(&mut self) {
        if self.length > 0 {
            (self.sink)(self.held.get(..self.length).unwrap_or_default());
            self.length = 0;
        }
    }

    /// Writes a word, without a copy of it.
    pub fn length(&mut self, letter: u8, steps: i64, decimals: u8) {
        if self.length > self.held.len() - DECIMAL {
            self.flush();
        }
        let room = self.held.get_mut(self.length..);
        if let Some(room) = room.and_then(<[u8]>::first_chunk_mut) {
            let written = decimal(room, Some(letter), steps, decimals);
            self.length = self.length.saturating_add(written);
        }
    }
}

impl<S: FnMut(&[u8])> core::fmt::Write for Out<'_, S> {
    fn write_str(&mut self, text: &str) -> core::fmt::Result {
        self.put(text.as_bytes());
        Ok(())
    }
}

/// Whether blanks stand between the words of a block; none if it has only one word.
pub(in crate::rewrite) fn is_spaced(words: &Words) -> Option<bool> {
    let (first, rest) = words.split_first()?;
    let next = rest.first()?;
    Some(next.start > first.end)
}

/// Whether a motion takes words of this letter.
const fn of_motion(letter: u8) -> bool {
    matches!(letter, b'X' | b'Y' | b'Z' | b'I' | b'J' | b'K' | b'R')
}

/// Whether an added word stands before one that is there: X Y Z, then I J K, then R.
const fn is_before(added: u8, there: u8) -> bool {
    const fn rank(letter: u8) -> u8 {
        match letter {
            b'X' | b'Y' | b'Z' => letter - b'X',
            b'I' | b'J' | b'K' => 3 + letter - b'I',
            _ => 6,
        }
    }
    rank(added) < rank(there)
}

/// Writes a block without its end.
pub(in crate::rewrite) fn block<S: FnMut(&[u8])>(
    line: &[u8],
    words: &Words,
    edit: &Edit,
    spaced: bool,
    out: &mut Out<'_, S>,
) {
    // Words that stay, with nothing to stand beside them, are not looked at: they are copied
    // with what lies between the others.
    let mut looked_at = edit.is_changed;
    // What is added stands in the order of letters, behind the last word of the motion at
    // the latest.
    let mut anchor = None;
    if edit.code.is_some() || !edit.added.is_empty() {
        for (number, word) in words.iter().enumerate() {
            if of_motion(word.letter) {
                looked_at |= bit(number);
                anchor = Some(number);
            }
        }
    }
    let mut code = edit.code;
    let mut added = Added {
        all: &edit.added,
        written: 0,
    };
    // What stands before has been written.
    let mut copied = 0;
    while looked_at != 0 {
        let number = looked_at.trailing_zeros() as usize;
        looked_at &= !bit(number);
        let Some(word) = words.get(number) else { break };
        let action = edit.action(number);
        let is_joined = (code.is_some() || added.wait()) && of_motion(word.letter);
        let end = if action == Action::Drop && code.is_none() {
            // The blanks before it go with it, a comment stays.
            let previous = number.checked_sub(1).and_then(|number| words.get(number));
            let before = previous.map_or(0, |word| word.end);
            let gap = line.get(before..word.start).unwrap_or_default();
            let comment = gap.iter().rposition(|byte| *byte == b')');
            comment.map_or(before, |at| before + at + 1)
        } else {
            word.start
        };
        out.put(line.get(copied..end).unwrap_or_default());
        if is_joined {
            let mut first = action != Action::Drop || code.is_some();
            let mut separate = |out: &mut Out<'_, S>| {
                // The gap has gone before the first.
                if !core::mem::replace(&mut first, false) && spaced {
                    out.put(b" ");
                }
            };
            if let Some(code) = code.take() {
                separate(out);
                out.put(code);
            }
            while let Some((letter, steps, decimals)) = added.before(word.letter) {
                separate(out);
                out.length(letter, steps, decimals);
            }
            if action != Action::Drop {
                separate(out);
            }
        }
        match action {
            Action::Keep => out.put(line.get(word.start..word.end).unwrap_or_default()),
            Action::Length(steps, decimals) => out.length(letter(line, word), steps, decimals),
            Action::Text(text) => out.put(text),
            Action::Drop => {}
        }
        if is_joined && anchor == Some(number) {
            for (letter, steps, decimals) in added.rest() {
                if spaced {
                    out.put(b" ");
                }
                out.length(*letter, *steps, *decimals);
            }
        }
        copied = word.end;
    }
    out.put(line.get(copied..).unwrap_or_default());
}

/// The words that are added, while they are written.
struct Added<'a> {
    all: &'a [(u8, i64, u8)],
    /// A bit for each that has been.
    written: u8,
}

impl Added<'_> {
    /// The next that stands before a word of this letter.
    fn before(&mut self, there: u8) -> Option<(u8, i64, u8)> {
        let (number, word) = self.all.iter().enumerate().find(|(number, (letter, ..))| {
            self.written >> number & 1 == 0 && is_before(*letter, there)
        })?;
        self.written |= 1 << number;
        Some(*word)
    }

    /// Whether there are such that have not been written yet.
    const fn wait(&self) -> bool {
        (self.written.count_ones() as usize) < self.all.len()
    }

    /// Those that wait still.
    fn rest(&self) -> impl Iterator<Item = &(u8, i64, u8)> {
        let written = self.written;
        self.all
            .iter()
            .enumerate()
            .filter(move |(number, _)| written >> number & 1 == 0)
            .map(|(_, word)| word)
    }
}

/// The letter of a word as it is written.
fn letter(line: &[u8], word: &Word) -> u8 {
    line.get(word.start).copied().unwrap_or(word.letter)
}

/// A number as it was written, without its sign if that was a plus.
pub(in crate::rewrite) fn number<S: FnMut(&[u8])>(number: Number, out: &mut Out<'_, S>) {
    let mut text = [0; DECIMAL];
    let length = decimal(&mut text, None, number.digits, number.decimals);
    let bytes = text.get(..length).unwrap_or_default();
    // Without a point it may count something else.
    match bytes.split_last() {
        Some((b'.', whole)) if !number.has_point => out.put(whole),
        _ => out.put(bytes),
    }
}
