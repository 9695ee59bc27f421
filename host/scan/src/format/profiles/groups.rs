//! The groups of a data channel as they come: what is written of them ends between two groups.

use crate::ScanError;

/// Bytes of size and control word.
const HEAD: usize = 6;
/// The largest message that makes sense, in bytes.
const LARGEST: usize = 1 << 26;
/// The largest group: a sensor that never ends one is none.
const LARGEST_GROUP: usize = 1 << 27;
/// The bit of the last message of its group.
const LAST: u8 = 0x80;

/// Puts pieces of a stream together to whole groups of messages.
#[derive(Debug, Default)]
pub struct Groups {
    waiting: Vec<u8>,
    /// Where the message begins that is not yet whole.
    at: usize,
    /// Bytes of all groups before.
    before: u64,
}

impl Groups {
    /// A piece has come.
    pub fn push(&mut self, bytes: &[u8]) {
        self.waiting.extend_from_slice(bytes);
    }

    /// Bytes of a group that is not whole.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// The next whole group, as it came.
    ///
    /// # Errors
    /// `corrupt`: this is no such channel.
    pub fn next_group(&mut self) -> Result<Option<Vec<u8>>, ScanError> {
        loop {
            let Some(head) = self.waiting.get(self.at..self.at + HEAD) else {
                return Ok(None);
            };
            let size = u32::from_le_bytes([head[0], head[1], head[2], head[3]]) as usize;
            let is_last = head[5] & LAST != 0;
            let end = self.at.saturating_add(size);
            if !(HEAD..=LARGEST).contains(&size) || end > LARGEST_GROUP {
                let byte = self.before + self.at as u64;
                return Err(ScanError::unreadable(
                    "corrupt",
                    format_args!(
                        "byte {byte} of the sensor's channel: a message of {size} bytes makes no \
                         sense; is this the data channel of the sensor?"
                    ),
                )
                .with("byte", byte));
            }
            if self.waiting.len() < end {
                return Ok(None);
            }
            self.at = end;
            if is_last {
                let rest = self.waiting.split_off(end);
                self.at = 0;
                self.before += end as u64;
                return Ok(Some(std::mem::replace(&mut self.waiting, rest)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(control: u16, body: usize) -> Vec<u8> {
        let mut bytes = ((HEAD + body) as u32).to_le_bytes().to_vec();
        bytes.extend(control.to_le_bytes());
        bytes.resize(HEAD + body, 7);
        bytes
    }

    #[test]
    fn any_split_gives_the_same_groups() {
        let groups = [
            [message(1, 8), message(0x8005, 20)].concat(),
            message(0x8063, 0),
            [message(1, 3), message(2, 2), message(0x8006, 1)].concat(),
        ];
        let stream = groups.concat();
        for size in 1..=stream.len() {
            let mut splitter = Groups::default();
            let mut came = Vec::new();
            for piece in stream.chunks(size) {
                splitter.push(piece);
                while let Some(group) = splitter.next_group().unwrap() {
                    came.push(group);
                }
            }
            assert_eq!(came, groups, "{size}");
            assert_eq!(splitter.waiting(), 0);
        }
    }

    #[test]
    fn what_is_no_channel_is_told() {
        for bytes in [[0_u8; 6], [5, 0, 0, 0, 0, 0], [255; 6], *b"GET / "] {
            let mut splitter = Groups::default();
            splitter.push(&bytes);
            assert_eq!(splitter.next_group().unwrap_err().code, "corrupt");
        }
        let mut splitter = Groups::default();
        splitter.push(&message(1, 4)[..9]);
        assert_eq!(splitter.next_group().unwrap(), None);
    }
}
