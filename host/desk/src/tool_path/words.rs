//! What a block says, read from its text: where it leads, what it makes depend on the control,
//! which modes it says.

use std::collections::{BTreeMap, BTreeSet};

use umi_client::files::tool_path::diff::ModeUse;
use umi_core::correction::RunCheck;
use umi_core::units::Point;
use umi_virtual::nc::{AxisMotion, ControlFamily, MotionPath};

/// A block without comments and blanks, in capitals, by its words.
pub(super) struct BlockWords {
    /// `/`, or `/2`; empty in most.
    skip: String,
    /// `N10`, or nothing.
    number: String,
    /// What stands behind these.
    text: String,
    /// The words of that; letters within brackets name functions.
    words: Vec<String>,
}

/// Blocks that something leads to: their numbers.
pub(super) struct JumpTargets {
    numbers: BTreeSet<String>,
    /// A variable says where it leads.
    are_all: bool,
}

/// Which modes a program has said so far.
pub(super) struct ModesSaid {
    said: BTreeSet<&'static str>,
    drills: bool,
    /// What a number without a point counts, depends on the control.
    counts_steps: bool,
}

impl BlockWords {
    pub fn of(block: &str) -> Self {
        let text = bare(block);
        let digits = |text: &str, from: usize| {
            let rest = text.get(from..).unwrap_or_default();
            from + rest.bytes().take_while(u8::is_ascii_digit).count()
        };
        let (mut skip, mut number) = (String::new(), String::new());
        let mut rest = text.as_str();
        // `N10/` is read as `/N10` is.
        for _ in 0..3 {
            let into = match rest.as_bytes() {
                [b'/', ..] => &mut skip,
                [b'N', b'0'..=b'9', ..] => &mut number,
                _ => break,
            };
            let (begin, behind) = rest.split_at(digits(rest, 1));
            begin.clone_into(into);
            rest = behind;
        }
        let mut words = Vec::new();
        let mut depth = 0_u32;
        for character in rest.chars() {
            let begins = depth == 0 && character.is_ascii_alphabetic();
            match character {
                '[' => depth += 1,
                ']' => depth = depth.saturating_sub(1),
                _ => {}
            }
            match words.last_mut() {
                Some(word) if !begins => String::push(word, character),
                _ => words.push(character.to_string()),
            }
        }
        Self {
            text: rest.to_owned(),
            skip,
            number,
            words,
        }
    }

    fn has(&self, word: &str) -> bool {
        self.words.iter().any(|of| of == word)
    }

    fn values(&self, letters: &str) -> impl Iterator<Item = &str> {
        let of = self
            .words
            .iter()
            .filter(move |word| word.starts_with(|c| letters.contains(c)));
        of.map(String::as_str)
    }

    /// Which axes the block sends to machine coordinates, and which it brings back.
    pub fn follow(&self, away: &mut [bool; 3]) -> bool {
        let leaves = ["G28", "G30", "G53"].iter().any(|code| self.has(code));
        for (axis, away) in ["X", "Y", "Z"].into_iter().zip(away) {
            if self.values(axis).next().is_some() {
                *away = leaves;
            }
        }
        leaves
    }

    /// Whether the program stops behind its motion.
    pub fn stops(&self) -> bool {
        ["M0", "M1", "M2", "M30"].iter().any(|code| self.has(code))
    }

    /// The block as it is compared: its number, where something leads to it, and what it says.
    pub fn labelled(&self, labels: &JumpTargets) -> String {
        let number = if labels.has(self) {
            self.number.as_str()
        } else {
            ""
        };
        [&self.skip, number, &self.text].concat()
    }

    /// What depends on what stands in the control, or acts there: all of a block that decides,
    /// computes or sets offsets; the words of one that moves, as `X#500`; of tools, M codes (but
    /// of spindle, coolant and calls) and modes of exact stop; the number of one that something
    /// leads to; and the `/` of one that may be left out.
    pub fn depends(&self, labels: &JumpTargets) -> impl Iterator<Item = String> {
        let mut found = Vec::new();
        if labels.has(self) {
            found.push(self.number.clone());
        }
        if !self.skip.is_empty() {
            // The words of a motion are elsewhere where it is carried. It never becomes several.
            let moves = self.values("XYZ").next().is_some() && !self.text.contains(['#', '[']);
            let text = if moves { "" } else { self.text.as_str() };
            found.push([&self.skip, text].concat());
        }
        let begins = |words: &[&str]| words.iter().any(|word| self.text.starts_with(word));
        if begins(&["DPRNT", "BPRNT", "POPEN", "PCLOS"]) {
            return found.into_iter();
        }
        if begins(&["IF", "WHILE", "GOTO", "DO", "END", "#", "O"]) || self.has("G10") {
            found.push(self.text.clone());
            return found.into_iter();
        }
        let acts = |word: &str| match word.split_at_checked(1) {
            Some(("T" | "H", number)) => !number.is_empty(),
            Some(("M", number)) => !matches!(
                number,
                "3" | "4" | "5" | "7" | "8" | "9" | "97" | "98" | "99"
            ),
            Some(("G", number)) => {
                let code = number.split_once('.').map_or(number, |(code, _)| code);
                matches!(code, "9" | "43" | "44" | "49" | "61" | "62" | "63" | "64")
            }
            _ => false,
        };
        // What belongs to such a code beside it, as the P of `G64 P0.01`.
        let owns = self.has("G64") || self.values("G").next().is_none();
        let owns = owns && self.values("GM").any(acts);
        let owned = |word: &str| owns && word.starts_with(['P', 'Q', 'E', 'L']);
        let is_it = |word: &&String| word.contains(['#', '[']) || acts(word) || owned(word);
        found.extend(self.words.iter().filter(is_it).cloned());
        found.into_iter()
    }
}

impl JumpTargets {
    /// Where the blocks of a program lead.
    pub fn in_blocks<'a>(
        blocks: impl Iterator<Item = &'a BlockWords>,
        check: Option<RunCheck>,
    ) -> Self {
        let mut found = Self {
            numbers: BTreeSet::new(),
            are_all: false,
        };
        for block in blocks.filter(|block| !is_of_run(&block.text, check)) {
            let after = block.text.split_once("GOTO").map(|(_, to)| to);
            let returns = block.has("M99") || block.has("M97");
            let by_p = block.values("P").next().filter(|_| returns);
            if let Some(to) = after.or(by_p.and_then(|word| word.get(1..))) {
                match to.bytes().all(|byte| byte.is_ascii_digit()) {
                    true => _ = found.numbers.insert(to.trim_start_matches('0').to_owned()),
                    false => found.are_all = true,
                }
            }
        }
        found
    }

    fn has(&self, block: &BlockWords) -> bool {
        let number = block.number.get(1..);
        number.is_some_and(|number| self.are_all || self.numbers.contains(number))
    }
}

/// The group of modes of a G code that is compared.
fn mode(code: &str) -> Option<&'static str> {
    Some(match code {
        "0" | "1" | "2" | "3" | "73" | "74" | "76" | "81" | "82" | "83" | "84" | "85" | "86"
        | "87" | "88" | "89" => "G0 to G3",
        "17" | "18" | "19" => "G17, G18 or G19",
        "20" | "21" => "G20 or G21",
        "40" | "41" | "42" => "G40",
        "54" | "55" | "56" | "57" | "58" | "59" | "54.1" | "59.1" | "59.2" | "59.3" | "154" => {
            "G54 or another work offset"
        }
        "68" | "69" => "G69",
        "90" | "91" => "G90 or G91",
        "90.1" | "91.1" => "G90.1 or G91.1",
        "98" | "99" => "G98 or G99",
        _ => return None,
    })
}

/// Whether a mode in force is compared where the program has ended.
pub(super) fn outlasts(code: &str) -> bool {
    let named = code.get(1..).and_then(mode);
    named.is_some_and(|named| !matches!(named, "G0 to G3" | "G40"))
}

impl ModesSaid {
    pub const fn new(dialect: ControlFamily) -> Self {
        Self {
            said: BTreeSet::new(),
            drills: false,
            counts_steps: dialect.is_macro_b(),
        }
    }

    /// Takes a block and the motions that it made: which modes count there first?
    pub fn count(
        &mut self,
        words: &BlockWords,
        (behind, line): (usize, u32),
        made: &[(Point, AxisMotion)],
        by_machine: bool,
        modes: &mut BTreeMap<&'static str, ModeUse>,
    ) {
        for code in words.values("G").filter_map(|word| word.get(1..)) {
            self.said.extend(mode(code));
            match mode(code) {
                Some("G0 to G3") => self.drills = code.len() > 1,
                _ => self.drills &= code != "80",
            }
        }
        if made.is_empty() {
            return;
        }
        let is_arc =
            |(_, motion): &(Point, AxisMotion)| matches!(motion.path, MotionPath::Arc { .. });
        let turns = made.iter().any(is_arc);
        for (name, counts) in [
            ("G20 or G21", true),
            ("G40", true),
            ("G69", true),
            ("G90 or G91", !by_machine),
            ("G54 or another work offset", !by_machine),
            ("G0 to G3", !by_machine),
            ("G17, G18 or G19", turns || self.drills),
            ("G90.1 or G91.1", turns),
            ("G98 or G99", self.drills),
        ] {
            if counts {
                let is_said = self.said.contains(name);
                modes.entry(name).or_insert(ModeUse {
                    is_said,
                    behind,
                    line,
                });
            }
        }
        let is_step = |word: &str| {
            let number = word
                .get(1..)
                .unwrap_or_default()
                .trim_start_matches(['-', '+']);
            number.bytes().all(|byte| byte.is_ascii_digit())
                && number.bytes().any(|byte| byte != b'0')
        };
        if self.counts_steps && words.values("XYZIJRQ").any(is_step) {
            let is_said = false;
            let name = "the unit of numbers without a point";
            modes.entry(name).or_insert(ModeUse {
                is_said,
                behind,
                line,
            });
        }
    }
}

/// Whether it leads the program elsewhere, or would in another state of the control.
pub(super) fn decides_the_way(what: &str) -> bool {
    let begins = ["IF", "WHILE", "GOTO", "P#", "P["];
    let within = ["IF[", "WHILE[", "REPEAT["];
    begins.iter().any(|word| what.starts_with(word))
        || (what.starts_with('O') && within.iter().any(|word| what.contains(word)))
        || (what.starts_with('/') && what.contains(|c: char| c.is_ascii_alphabetic()))
}

/// Whether this is the comparison of the run, with which a rewritten program begins.
pub(super) fn is_of_run(what: &str, check: Option<RunCheck>) -> bool {
    let Some(check) = check else { return false };
    let compared = ["NE", "EQ"].map(|how| format!("#{}{how}{}]", check.variable(), check.run()));
    what == "O531ENDIF"
        || what == "#3000=2"
        || compared
            .iter()
            .any(|compared| what.contains(compared.as_str()))
}

/// A block without comments and blanks, in capitals, its codes without zeros in front.
fn bare(block: &str) -> String {
    let mut in_comment = false;
    let characters = block
        .split(';')
        .next()
        .unwrap_or_default()
        .chars()
        .filter(|character| {
            in_comment = (in_comment || *character == '(') && *character != ')';
            !in_comment && !matches!(character, ')' | ' ' | '\t')
        })
        .map(|character| character.to_ascii_uppercase());
    let mut text = String::new();
    for character in characters {
        if character.is_ascii_digit() && text.ends_with('0') {
            let code = text.trim_end_matches('0').chars().next_back();
            if matches!(code, Some('G' | 'M' | 'T' | 'H' | 'N')) {
                text.pop();
            }
        }
        text.push(character);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What depends on the control is found, in words and in whole blocks, and what is printed is not.
    #[test]
    fn what_depends_is_found() {
        let blocks = ["GOTO 99", "M99 P0012"].map(BlockWords::of);
        let labels = JumpTargets::in_blocks(blocks.iter(), None);
        for (block, wanted) in [
            ("G1 X1. Y-2. (X#5)", &[][..]),
            ("N10 G0 X#500 Y[#1+COS[3]] Z1.", &["X#500", "Y[#1+COS[3]]"]),
            ("IF [#500 EQ 1] GOTO 99", &["IF[#500EQ1]GOTO99"]),
            ("N7 #3 = 5", &["#3=5"]),
            ("N8 G43 H2 Z50.", &["G43", "H2"]),
            ("/G1 X5.", &["/"]),
            ("N9 /2 M30", &["/2M30", "M30"]),
            ("o100 if [#1 GT 2]", &["O100IF[#1GT2]"]),
            ("DPRNT[X#5041[53]]", &[]),
            ("N099 T02 M06", &["N99", "T2", "M6"]),
            ("N12 S900 M3 M8", &["N12"]),
            ("M21 P3", &["M21", "P3"]),
            ("G64 P0.01", &["G64", "P0.01"]),
            ("G4 P1", &[]),
            ("G90 G10 L2 P1 X5.", &["G90G10L2P1X5."]),
        ] {
            let found: Vec<String> = BlockWords::of(block).depends(&labels).collect();
            assert_eq!(found, wanted, "{block}");
        }
    }
}
