//! A serial line between two ports that may be set differently: what one hears of the other.
//!
//! # Model
//!
//! The sender's characters are levels in time: a start bit, eight bits from the lowest, its stop
//! bits, one after the other without a gap, and rest around them. The receiver waits for a fall,
//! looks at the middle of each of its own bits, and takes the character if the stop bit is there;
//! else it is broken. Then it waits for the next fall, as UARTs do.

use umi_protocol::serial::LineSettings;

/// What a port hears.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Heard {
    /// A character.
    Byte(u8),
    /// One without its stop bit.
    Broken,
}

/// What a port set like `set` hears of bytes that one set like `sent` sends without a gap.
pub(crate) fn heard(bytes: &[u8], sent: &LineSettings, set: &LineSettings) -> Vec<Heard> {
    if sent.baud == set.baud {
        // A second stop bit is rest to who wants one only.
        return bytes.iter().copied().map(Heard::Byte).collect();
    }
    hears(&levels(bytes, sent.stop_bits), sent, set)
}

/// The levels of characters without a gap, one for each bit.
fn levels(bytes: &[u8], stop_bits: u8) -> Vec<bool> {
    let mut levels = Vec::with_capacity(bytes.len() * 11);
    for byte in bytes {
        levels.push(false);
        levels.extend((0..8).map(|bit| byte >> bit & 1 == 1));
        levels.extend((0..stop_bits).map(|_| true));
    }
    levels
}

/// What a port set like `set` hears of levels that one set like `sent` sends.
fn hears(levels: &[bool], sent: &LineSettings, set: &LineSettings) -> Vec<Heard> {
    // Time in ticks that divide both bits.
    let (sent_ticks, set_ticks) = (u64::from(set.baud), u64::from(sent.baud));
    let at = |tick: u64| {
        let bit = usize::try_from(tick / sent_ticks).unwrap_or(usize::MAX);
        levels.get(bit).copied().unwrap_or(true)
    };
    let mut heard = Vec::new();
    // The line rested before the first.
    let mut bit = None;
    while let Some(start) = fall(levels, bit) {
        let begin = start as u64 * sent_ticks;
        let middle = |nth: u64| begin + nth * set_ticks + set_ticks / 2;
        // A start bit that is gone at its middle was none.
        if at(middle(0)) {
            bit = Some(start + 1);
            continue;
        }
        let byte = (0..8).fold(0, |byte, nth| byte | u8::from(at(middle(nth + 1))) << nth);
        let stop = middle(9);
        heard.push(match at(stop) {
            true => Heard::Byte(byte),
            false => Heard::Broken,
        });
        bit = Some(usize::try_from(stop / sent_ticks).unwrap_or(usize::MAX));
    }
    heard
}

/// The first fall of the line to a bit behind this one; none: from the rest before the first bit.
fn fall(levels: &[bool], behind: Option<usize>) -> Option<usize> {
    let from = match behind {
        None if levels.first() == Some(&false) => return Some(0),
        from => from.unwrap_or_default(),
    };
    let mut pairs = levels.iter().zip(levels.iter().skip(1)).enumerate();
    pairs
        .find(|(nth, (before, level))| *nth >= from && **before && !**level)
        .map(|(nth, _)| nth + 1)
}

#[cfg(test)]
mod tests {
    use umi_core::dprnt::{Coding, encode};
    use umi_protocol::serial::ALIGNING_CHARACTERS;

    use super::*;

    fn at(baud: u32, stop_bits: u8) -> LineSettings {
        LineSettings {
            baud,
            stop_bits,
            ..LineSettings::DEFAULT
        }
    }

    const TEXT: &[u8] = b"UMI1 R 17 S 3 X- 135.019 Y- 136.620 C 4113.0474\r\n";

    fn bytes(of: &[Heard]) -> Vec<u8> {
        let bytes = of.iter().filter_map(|heard| match heard {
            Heard::Byte(byte) => Some(*byte),
            Heard::Broken => None,
        });
        bytes.collect()
    }

    /// Two ports of one speed understand each other, whatever their stop bits; ports that are one
    /// percent apart do, too.
    #[test]
    fn the_same_speed_is_heard() {
        for (sent, set) in [
            (at(9600, 1), at(9600, 2)),
            (at(9600, 2), at(9600, 1)),
            (at(9600, 2), at(9696, 1)),
            (at(9600, 1), at(9504, 1)),
        ] {
            assert_eq!(bytes(&heard(TEXT, &sent, &set)), TEXT, "{sent:?} {set:?}");
        }
    }

    /// A port that is opened in the midst of a text without a gap hears it right from some character on, which is never
    /// further than `umi line find` lets pass.
    #[test]
    fn a_port_that_opens_in_the_midst_finds_the_characters() {
        let mut longest = 0;
        for (stop_bits, coding) in [
            (1, Coding::Ascii),
            (2, Coding::Ascii),
            (1, Coding::IsoEven),
            (2, Coding::IsoEven),
            (2, Coding::Eia),
        ] {
            let line: Vec<u8> = TEXT.iter().filter_map(|b| encode(coding, *b)).collect();
            let text = line.repeat(8);
            let sent = levels(&text, stop_bits);
            let of = at(9600, stop_bits);
            for skipped in 0..line.len() * (9 + usize::from(stop_bits)) {
                let heard = hears(&sent[skipped..], &of, &of);
                let right = heard.iter().rev().zip(text.iter().rev());
                let right = right.take_while(|(heard, byte)| **heard == Heard::Byte(**byte));
                longest = longest.max(heard.len() - right.count());
            }
        }
        assert!(
            (20..ALIGNING_CHARACTERS as usize).contains(&longest),
            "{longest}"
        );
    }

    /// At any other usual speed nothing of the text comes through, in either direction.
    #[test]
    fn another_speed_is_not_heard() {
        for sent in umi_protocol::serial::USUAL_BAUD {
            for set in umi_protocol::serial::USUAL_BAUD {
                if sent == set {
                    continue;
                }
                let of = heard(TEXT, &at(sent, 2), &at(set, 1));
                let found = bytes(&of);
                assert!(
                    !found
                        .windows(4)
                        .any(|four| TEXT.windows(4).any(|text| text == four)),
                    "{sent} {set}: {found:?}"
                );
            }
        }
    }

    /// By hand: `U` is 0 10101010 1; at half the speed two of its bits are one.
    #[test]
    fn a_character_worked_out_by_hand() {
        // Levels 0 1 0 1 0 1 0 1 0 1, then rest. Twice as long bits have their middles at the
        // second sender's bit of each pair: start 1, which is no start bit.
        assert_eq!(heard(b"U", &at(9600, 1), &at(4800, 1)), []);
        // NUL is nine bits low: a break for who is four times as fast.
        let fast = heard(&[0], &at(9600, 1), &at(38_400, 1));
        assert_eq!(fast, [Heard::Broken]);
    }
}
