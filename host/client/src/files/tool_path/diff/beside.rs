//! What programs say beside their motions: at which of them it stands, and what they take for
//! granted.

use std::collections::BTreeMap;

use umi_core::registration::RigidTransform;

use super::PathDifference;

/// What a program says beside its motions: what depends on the control (variables, lengths,
/// decisions, `/`), and what acts there (T, M, `G10`, `G61`).
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Depends {
    /// Motions before it.
    pub behind: usize,
    /// What, as `IF[#500EQ1]GOTO99`, `X#500`, `H2`, `M6` or `/`.
    pub what: String,
    /// Its line, from 1.
    pub line: u32,
}

/// Whether a mode was said when it counted first.
#[derive(Clone, Copy, Debug)]
pub struct ModeUse {
    /// Otherwise the program takes it for granted.
    pub is_said: bool,
    /// Motions before it counted.
    pub behind: usize,
    /// Where it counted, a line from 1.
    pub line: u32,
}

/// What of a program is no motion.
#[derive(Clone, Debug, Default)]
pub struct BesideMotions {
    /// What depends on the control or acts there, as it was run.
    pub depends: Vec<Depends>,
    /// Blocks that were not run and would be, were the control in another state.
    pub not_run: Vec<Depends>,
    /// The modes that counted, by their names.
    pub modes: BTreeMap<&'static str, ModeUse>,
}

impl Depends {
    /// Whether it is a whole block, and no word of one that moves.
    fn is_statement(&self) -> bool {
        let begins = self.what.as_bytes();
        !matches!(begins, [letter, b'#' | b'[', ..] if letter.is_ascii_alphabetic())
    }
}

impl PathDifference {
    /// Takes what both say beside the motions that were compared.
    pub fn compare_beside(
        &mut self,
        first: &BesideMotions,
        second: &BesideMotions,
        transform: &RigidTransform,
    ) {
        self.decides = differing(&self.met, &first.depends, &second.depends);
        self.not_run = differing(&self.met, &first.not_run, &second.not_run);
        // Of what was not run nobody knows whether it is moved.
        if *transform != RigidTransform::identity() {
            let moves = |of: &&Depends| of.what.contains(['X', 'Y', 'Z']);
            let moving = first.not_run.iter().filter(moves).cloned();
            self.not_run[0].extend(moving);
        }
        let names = first.modes.keys().chain(second.modes.keys());
        for name in names.collect::<std::collections::BTreeSet<_>>() {
            let [a, b] = [first, second].map(|of| of.modes.get(name));
            let stretch =
                |at: usize, of: &ModeUse| self.met.partition_point(|met| met[at] <= of.behind);
            let is_there = matches!((a, b), (Some(a), Some(b)) if stretch(0, a) == stretch(1, b));
            let granted = |of: Option<&ModeUse>| of.filter(|of| !of.is_said).map(|of| of.line);
            // A cycle or arc may have been written out: then it counts behind another motion there.
            let (of, line) = match (granted(a), granted(b)) {
                (None, Some(line)) => (1, line),
                (Some(line), None) if is_there => (0, line),
                _ => continue,
            };
            self.granted[of].push(Depends {
                behind: 0,
                what: (*name).to_owned(),
                line,
            });
        }
    }
}

/// What stands in one of two programs only, or behind another motion there.
fn differing(met: &[[usize; 2]], first: &[Depends], second: &[Depends]) -> [Vec<Depends>; 2] {
    let stretch = |of: usize, what: &Depends| met.partition_point(|met| met[of] <= what.behind);
    let mut found = [Vec::new(), Vec::new()];
    let mut rest = first;
    let mut passed: (usize, Vec<&str>) = (0, Vec::new());
    for made in second {
        let at = stretch(1, made);
        if passed.0 != at {
            passed = (at, Vec::new());
        }
        let before = rest.partition_point(|of| stretch(0, of) < at);
        let here = rest.partition_point(|of| stretch(0, of) <= at);
        let is_it = |of: &Depends| of.what == made.what;
        let next = rest[before..here].iter().position(is_it);
        let (left_out, behind) = rest.split_at(before + next.unwrap_or(0));
        found[0].extend_from_slice(left_out);
        rest = behind;
        match (next, rest) {
            (Some(_), [of, behind @ ..]) => {
                passed.1.push(&of.what);
                rest = behind;
            }
            // A word may stand in each of the lines that one was written out to.
            _ if !made.is_statement() && passed.1.contains(&made.what.as_str()) => {}
            _ => found[1].push(made.clone()),
        }
    }
    found[0].extend_from_slice(rest);
    found
}
