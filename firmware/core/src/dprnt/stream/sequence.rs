//! Sequence numbers of checked lines: gaps and repeats.
//!
//! A control that is restarted inside a program executes earlier outputs again
//! (Brother, NC programming manual eCOM3NCPR6, section 6.6), and it prints in
//! dry run too. So a line may come twice; it counts once.

/// Lines that are remembered. A restart further back cannot be compared.
const REMEMBERED: usize = 64;
/// No line: no check value is as large.
const ABSENT: u32 = u32::MAX;

/// What a run and sequence number means after those that came before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::dprnt) enum Arrival {
    /// As expected, or late.
    New,
    /// New, but these before it are missing.
    AfterGap { from: u32, to: u32 },
    /// It has come before with the same content.
    Repeat,
    /// It has come before with other content, or too long ago to compare.
    Conflict { compared: bool },
}

/// The lines of the present run.
#[derive(Clone, Debug)]
pub(in crate::dprnt) struct Sequence {
    run: Option<u32>,
    last: u32,
    checks: [u32; REMEMBERED],
}

impl Sequence {
    pub const fn new() -> Self {
        Self {
            run: None,
            last: 0,
            checks: [ABSENT; REMEMBERED],
        }
    }

    /// Notes a line. Its check value stands for its content: two contents that
    /// differ in one field never have the same.
    pub fn note(&mut self, run: u32, sequence: u32, check: u32) -> Arrival {
        if self.run != Some(run) {
            *self = Self::new();
            self.run = Some(run);
        }
        if sequence > self.last {
            let from = self.last + 1;
            // Forget what stood in the places of the missing ones.
            for missing in (from..sequence).rev().take(REMEMBERED) {
                self.put(missing, ABSENT);
            }
            self.last = sequence;
            self.put(sequence, check);
            return if from < sequence {
                Arrival::AfterGap {
                    from,
                    to: sequence - 1,
                }
            } else {
                Arrival::New
            };
        }
        if usize::try_from(self.last - sequence).is_ok_and(|age| age >= REMEMBERED) {
            return Arrival::Conflict { compared: false };
        }
        match self.at(sequence) {
            ABSENT => {
                self.put(sequence, check);
                Arrival::New
            }
            known if known == check => Arrival::Repeat,
            _ => Arrival::Conflict { compared: true },
        }
    }

    fn place(sequence: u32) -> usize {
        usize::try_from(sequence).unwrap_or(0) % REMEMBERED
    }

    fn at(&self, sequence: u32) -> u32 {
        self.checks
            .get(Self::place(sequence))
            .copied()
            .unwrap_or(ABSENT)
    }

    fn put(&mut self, sequence: u32, check: u32) {
        if let Some(place) = self.checks.get_mut(Self::place(sequence)) {
            *place = check;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In order, missing, late, again, again with other content, too old.
    #[test]
    fn arrivals() {
        let mut sequence = Sequence::new();
        assert_eq!(sequence.note(7, 1, 11), Arrival::New);
        assert_eq!(sequence.note(7, 2, 12), Arrival::New);
        assert_eq!(
            sequence.note(7, 5, 15),
            Arrival::AfterGap { from: 3, to: 4 }
        );
        assert_eq!(sequence.note(7, 4, 14), Arrival::New);
        assert_eq!(sequence.note(7, 2, 12), Arrival::Repeat);
        assert_eq!(sequence.note(7, 4, 14), Arrival::Repeat);
        assert_eq!(
            sequence.note(7, 1, 12),
            Arrival::Conflict { compared: true }
        );
        assert_eq!(
            sequence.note(7, 80, 1),
            Arrival::AfterGap { from: 6, to: 79 }
        );
        assert_eq!(
            sequence.note(7, 1, 11),
            Arrival::Conflict { compared: false }
        );
        assert_eq!(
            sequence.note(7, 17, 3),
            Arrival::New,
            "missing, not repeated"
        );
    }

    /// A new run begins at 1; one that does not has lost its beginning.
    #[test]
    fn a_new_run_begins_at_one() {
        let mut sequence = Sequence::new();
        assert_eq!(sequence.note(1, 1, 5), Arrival::New);
        assert_eq!(sequence.note(2, 1, 5), Arrival::New);
        assert_eq!(sequence.note(3, 4, 5), Arrival::AfterGap { from: 1, to: 3 });
    }
}
