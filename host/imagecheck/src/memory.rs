//! Data words of an image, and which addresses are reachable from them.

use std::collections::{BTreeMap, BTreeSet};

/// A word of data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DataWord {
    /// Where it is.
    pub address: u64,
    /// What it says.
    pub value: u64,
    /// Whether the program can change it.
    pub is_variable: bool,
}

/// Words of data, divided where anything points to.
#[derive(Debug, Default)]
pub struct Memory {
    words: BTreeMap<u64, DataWord>,
    starts: BTreeSet<u64>,
    known: BTreeSet<u64>,
}

impl Memory {
    /// The memory of these words, to which the code knows these addresses.
    pub fn new(words: &[DataWord], addresses: impl Iterator<Item = u64>) -> Self {
        let values = words.iter().map(|word| word.value);
        Self {
            words: words.iter().map(|word| (word.address, *word)).collect(),
            starts: addresses.chain(values).collect(),
            known: BTreeSet::new(),
        }
    }

    /// All values that one can come to who knows these: what stands at each, up to the next
    /// address that anything points to, and so on.
    pub fn from(&mut self, values: &[u64]) -> BTreeSet<u64> {
        let mut found = BTreeSet::new();
        let mut open = values.to_vec();
        while let Some(value) = open.pop() {
            if !found.insert(value) {
                continue;
            }
            let end = self
                .starts
                .range(value + 1..)
                .next()
                .copied()
                .unwrap_or(u64::MAX);
            // What is stored into a variable, anyone may have stored.
            let words = self
                .words
                .range(value..end)
                .filter(|(_, word)| !word.is_variable);
            for (address, word) in words {
                self.known.insert(*address);
                open.push(word.value);
            }
        }
        found
    }

    /// The values in variables, and in what no one who was asked about can come to.
    pub fn rest(&self) -> Vec<u64> {
        let words = self.words.values();
        let rest = words.filter(|word| word.is_variable || !self.known.contains(&word.address));
        rest.map(|word| word.value).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One table ends where the next begins; tables lead to tables; variables and what no one
    /// knows are the rest.
    #[test]
    fn tables() {
        let word = |address, value, is_variable| DataWord {
            address,
            value,
            is_variable,
        };
        let words = [
            word(0x10, 7, false),
            word(0x14, 0x20, false), // leads to the table at 0x20
            word(0x18, 8, false),    // a table of its own
            word(0x20, 9, false),
            word(0x30, 11, true),
            word(0x40, 0x50, true),
            word(0x50, 12, false), // known to the variable at 0x40
        ];
        let mut memory = Memory::new(&words, [0x10, 0x18, 0x30].into_iter());
        assert_eq!(memory.from(&[0x10]), BTreeSet::from([0x10, 7, 0x20, 9]));
        assert_eq!(memory.from(&[0x18, 0x30]), BTreeSet::from([0x18, 8, 0x30]));
        assert_eq!(memory.rest(), [11, 0x50, 12]);
    }
}
