//! Programs: a loaded text split into programs and blocks, its loops and branches paired.

use std::collections::HashMap;

use super::block::{Block, Statement};
use super::expression::Expr;
use super::oword::Flow;
use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::settings::ControlFamily;

/// A program in memory.
#[derive(Clone, Debug)]
pub(crate) struct Program {
    /// Its O number; 0 if it has none.
    pub number: u32,
    /// Its blocks.
    pub blocks: Vec<Block>,
    /// For each block of flow, where it leads.
    pub links: HashMap<usize, Link>,
    /// The loop (index of its `DO`) in which a block stands, none outside.
    inside: Vec<Option<usize>>,
    /// Where each N number stands, in order.
    numbers: HashMap<u32, Vec<usize>>,
    /// LinuxCNC: where each subroutine begins (its `sub`).
    pub subs: HashMap<String, usize>,
}

/// Where a block of flow leads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Link {
    /// The first block of the construct.
    pub begin: usize,
    /// The next branch (`elseif`, `else`), or the end.
    pub next: usize,
    /// The last block of the construct.
    pub end: usize,
}

/// Blocks in one text. It bounds the memory that a text takes, as a block takes more than
/// its characters; a part program of 4 MB has about this many.
const MAX_BLOCKS: usize = 250_000;

/// Splits a text into programs: at `%`, and at O numbers (Fanuc also `:`). Lines that say
/// nothing (blank, comments alone) are not kept.
///
/// # Errors
/// More than [`MAX_BLOCKS`] blocks.
pub(crate) fn split(text: &str, dialect: ControlFamily) -> Checked<Vec<Program>> {
    let mut programs = Vec::new();
    let mut number = None;
    let mut blocks: Vec<Block> = Vec::new();
    let mut count = 0;
    // In LinuxCNC a comment may act.
    let acts = |block: &Block| dialect == ControlFamily::LinuxCnc && block.comment_acts();
    let mut finish = |number: &mut Option<u32>, blocks: &mut Vec<Block>| {
        if number.is_some() || blocks.iter().any(|b| says_something(b) || acts(b)) {
            programs.push(Program::new(
                number.unwrap_or(0),
                std::mem::take(blocks),
                dialect,
            ));
        }
        blocks.clear();
        *number = None;
    };
    for (index, text) in lines(text).enumerate() {
        let line = u32::try_from(index).unwrap_or(u32::MAX).saturating_add(1);
        if text.trim_start().starts_with('%') {
            let is_end = blocks.iter().any(says_something);
            finish(&mut number, &mut blocks);
            if is_end && !dialect.is_macro_b() {
                break;
            }
            continue;
        }
        let heading = dialect.is_macro_b().then(|| heading(text)).flatten();
        match heading {
            Some((o, rest)) => {
                finish(&mut number, &mut blocks);
                number = Some(o);
                blocks.push(Block::read(line, rest, dialect));
            }
            None if text.trim().is_empty() => continue,
            None => {
                let block = Block::read(line, text, dialect);
                let is_kept = says_something(&block)
                    || block.n.is_some()
                    || !block.warnings.is_empty()
                    || acts(&block);
                if !is_kept {
                    continue;
                }
                blocks.push(block);
            }
        }
        count += 1;
        if count > MAX_BLOCKS {
            return Err(Fault::new(format!(
                "more than {MAX_BLOCKS} blocks (line {line}): split the text"
            )));
        }
    }
    finish(&mut number, &mut blocks);
    Ok(programs)
}

/// Lines, ended by any run of CR around one LF, or by CR alone.
fn lines(text: &str) -> impl Iterator<Item = &str> {
    let has_lf = text.contains('\n');
    text.split(if has_lf { '\n' } else { '\r' })
        .map(|line| line.trim_matches(['\r', '\0']))
}

fn says_something(block: &Block) -> bool {
    !matches!(&block.statement, Ok(Statement::Words(words, assigns))
        if words.is_empty() && assigns.is_empty())
}

/// Whether a block is an end of program alone, as LinuxCNC's manual puts it behind the
/// subroutine in a file of its own.
fn is_end(block: &Block) -> bool {
    match &block.statement {
        Ok(Statement::Words(words, assigns)) if assigns.is_empty() => match words.as_slice() {
            [word] => word.letter == b'M' && matches!(word.value.constant(), Some(2.0 | 30.0)),
            _ => false,
        },
        _ => false,
    }
}

/// An O number at the beginning of a line, and what follows it.
fn heading(line: &str) -> Option<(u32, &str)> {
    let rest = line.trim_start().strip_prefix(['O', 'o', ':'])?;
    let end = rest
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(rest.len());
    let (digits, rest) = rest.split_at_checked(end)?;
    let number = digits.parse().ok().filter(|n| *n <= 99_999_999)?;
    Some((number, rest))
}

impl Program {
    fn new(number: u32, blocks: Vec<Block>, dialect: ControlFamily) -> Self {
        let mut numbers: HashMap<u32, Vec<usize>> = HashMap::new();
        for (index, block) in blocks.iter().enumerate() {
            if let Some(n) = block.n {
                numbers.entry(n).or_default().push(index);
            }
        }
        let mut program = Self {
            number,
            inside: vec![None; blocks.len()],
            blocks,
            links: HashMap::new(),
            numbers,
            subs: HashMap::new(),
        };
        if dialect == ControlFamily::LinuxCnc {
            program.pair_owords();
        } else {
            program.pair_loops();
        }
        program
    }

    /// The block with this N number: forward from here, then from the beginning.
    pub fn find(&self, n: u32, from: usize) -> Option<usize> {
        let places = self.numbers.get(&n)?;
        places
            .iter()
            .find(|place| **place >= from)
            .or_else(|| places.first())
            .copied()
    }

    /// Whether a jump between these blocks stays inside or leaves loops; into a loop it
    /// must not lead.
    pub fn may_jump(&self, from: usize, to: usize) -> bool {
        let Some(target) = self.inside.get(to).copied().flatten() else {
            return true;
        };
        let mut at = self.inside.get(from).copied().flatten();
        while let Some(index) = at {
            if index == target {
                return true;
            }
            at = self.inside.get(index).copied().flatten();
        }
        false
    }

    fn fail(&mut self, index: usize, fault: Fault) {
        if let Some(block) = self.blocks.get_mut(index)
            && block.statement.is_ok()
        {
            block.statement = Err(fault);
        }
    }

    /// Pairs `DO` and `END` (Custom Macro B).
    fn pair_loops(&mut self) {
        let mut open: Vec<(u8, usize)> = Vec::new();
        for index in 0..self.blocks.len() {
            if let Some(inside) = self.inside.get_mut(index) {
                *inside = open.last().map(|(_, begin)| *begin);
            }
            match self.blocks.get(index).map(|b| &b.statement) {
                Some(Ok(Statement::Do(_, label))) => {
                    let label = *label;
                    if open.iter().any(|(other, _)| *other == label) {
                        self.fail(
                            index,
                            Fault::ps(124, format!("DO{label} inside DO{label}: number it anew")),
                        );
                    } else {
                        open.push((label, index));
                    }
                }
                Some(Ok(Statement::End(label))) => {
                    let label = *label;
                    if open.last().is_some_and(|(other, _)| *other == label) {
                        if let Some((_, begin)) = open.pop() {
                            let link = Link {
                                begin,
                                next: index,
                                end: index,
                            };
                            self.links.insert(begin, link);
                            self.links.insert(index, link);
                        }
                    } else {
                        self.fail(
                            index,
                            Fault::ps(124, format!("END{label} does not close the innermost DO")),
                        );
                    }
                }
                _ => {}
            }
        }
        for (label, index) in open {
            self.fail(
                index,
                Fault::ps(124, format!("DO{label} has no END{label}: add it")),
            );
        }
    }

    /// Pairs the O words of LinuxCNC, and notes the subroutines.
    fn pair_owords(&mut self) {
        struct Open {
            label: String,
            /// Its branches: if, elseif, else; one for all others.
            branches: Vec<usize>,
            flow: Flow,
        }
        let mut open: Vec<Open> = Vec::new();
        for index in 0..self.blocks.len() {
            if let Some(inside) = self.inside.get_mut(index) {
                *inside = open.last().and_then(|o| o.branches.first()).copied();
            }
            let Some(Ok(Statement::OWord(word))) = self.blocks.get(index).map(|b| &b.statement)
            else {
                continue;
            };
            let word = word.clone();
            let innermost = open.last().filter(|o| o.label == word.label);
            let is_end_of_do = innermost.is_some_and(|o| o.flow == Flow::Do);
            match &word.flow {
                Flow::Sub => {
                    if !open.is_empty() {
                        self.fail(index, Fault::new("a sub inside another construct"));
                        continue;
                    }
                    self.subs.insert(word.label.clone(), index);
                }
                Flow::While(_) if is_end_of_do => {
                    self.close(
                        &mut open.pop().map(|o| o.branches).unwrap_or_default(),
                        index,
                    );
                    continue;
                }
                Flow::If(_) | Flow::While(_) | Flow::Do | Flow::Repeat(_) => {}
                Flow::Return(_) | Flow::Call(_) => continue,
                Flow::Break | Flow::Continue => {
                    let of = open
                        .iter()
                        .rev()
                        .find(|o| {
                            o.label == word.label
                                && matches!(o.flow, Flow::While(_) | Flow::Do | Flow::Repeat(_))
                        })
                        .and_then(|o| o.branches.first().copied());
                    match of {
                        // The end is known once the loop is closed; its begin leads there.
                        Some(begin) => {
                            self.links.insert(
                                index,
                                Link {
                                    begin,
                                    next: begin,
                                    end: begin,
                                },
                            );
                        }
                        None => self.fail(index, Fault::new("no loop of this label around it")),
                    }
                    continue;
                }
                Flow::ElseIf(_) | Flow::Else => {
                    match open.last_mut().filter(|o| {
                        o.label == word.label && matches!(o.flow, Flow::If(_) | Flow::ElseIf(_))
                    }) {
                        Some(of) => {
                            of.branches.push(index);
                            of.flow = word.flow.clone();
                        }
                        None => self.fail(
                            index,
                            Fault::new("not behind an `if` or `elseif` of the same label"),
                        ),
                    }
                    continue;
                }
                Flow::EndSub(_) | Flow::EndIf | Flow::EndWhile | Flow::EndRepeat => {
                    let fits = innermost.is_some_and(|o| match word.flow {
                        Flow::EndSub(_) => o.flow == Flow::Sub,
                        Flow::EndIf => {
                            matches!(o.flow, Flow::If(_) | Flow::ElseIf(_) | Flow::Else)
                        }
                        Flow::EndWhile => matches!(o.flow, Flow::While(_)),
                        _ => matches!(o.flow, Flow::Repeat(_)),
                    });
                    if fits {
                        self.close(
                            &mut open.pop().map(|o| o.branches).unwrap_or_default(),
                            index,
                        );
                    } else {
                        self.fail(
                            index,
                            Fault::new("it does not close the innermost construct of its label"),
                        );
                    }
                    continue;
                }
            }
            open.push(Open {
                label: word.label,
                branches: vec![index],
                flow: word.flow,
            });
        }
        for construct in open {
            if let Some(index) = construct.branches.first() {
                self.fail(
                    *index,
                    Fault::new(format!("o{} is not closed", construct.label)),
                );
            }
        }
    }

    /// Notes where the branches of a construct lead, now that its end is known.
    fn close(&mut self, branches: &mut Vec<usize>, end: usize) {
        branches.push(end);
        let begin = branches.first().copied().unwrap_or(end);
        for pair in branches.windows(2) {
            if let [at, next] = *pair {
                let next = next.min(end);
                self.links.insert(at, Link { begin, next, end });
            }
        }
        self.links.insert(
            end,
            Link {
                begin,
                next: end,
                end,
            },
        );
    }

    /// Whether all that a LinuxCNC text says stands in subroutines.
    pub fn is_library(&self) -> bool {
        !self.subs.is_empty()
            && self.blocks.iter().enumerate().all(|(index, block)| {
                !says_something(block)
                    || is_end(block)
                    || self.inside.get(index).copied().flatten().is_some()
                    || matches!(&block.statement, Ok(Statement::OWord(word))
                        if matches!(word.flow, Flow::Sub | Flow::EndSub(_)))
            })
    }

    /// The numbers to which a `GOTO` of this block leads, if it is written there.
    pub fn target_of(statement: &Statement) -> Option<f64> {
        let target: &Expr = match statement {
            Statement::Goto(target) | Statement::IfGoto(_, target) => target,
            _ => return None,
        };
        target.constant()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fanuc(text: &str) -> Vec<Program> {
        split(text, ControlFamily::Fanuc).expect("not too long")
    }

    /// Several programs in a text, headings with O and `:`, all line ends of the wire.
    #[test]
    fn splitting() {
        let programs = fanuc("%\r\nO1040(A)\r\nG1\r\n:0001\r\nM99\r\n%\r\n");
        let numbers: Vec<_> = programs.iter().map(|p| p.number).collect();
        assert_eq!(numbers, [1040, 1]);
        assert_eq!(programs[0].blocks.len(), 2);
        assert_eq!(programs[0].blocks[1].line, 3);
        assert_eq!(fanuc("%\n\r\rO2\n\r\rM30\n\r\r%")[0].blocks.len(), 2);
        assert_eq!(fanuc("G1\rM30\r")[0].number, 0);
        assert_eq!(fanuc("%\n\n%").len(), 0);
    }

    /// Lines that say nothing cost nothing, and their number is bounded by the text alone.
    #[test]
    fn blank_lines_are_not_kept() {
        for line in ["\n", "(X)\n", "/\n", " \t\r\n"] {
            let text = format!("O1\n{}M30\n", line.repeat((4 << 20) / line.len()));
            for dialect in [ControlFamily::Fanuc, ControlFamily::Grbl] {
                let programs = split(&text, dialect).expect("not too long");
                let blocks = &programs[0].blocks;
                assert!(blocks.len() <= 2, "{line:?}: {}", blocks.len());
                let lines = u32::try_from((4 << 20) / line.len()).expect("small");
                assert_eq!(blocks[blocks.len() - 1].line, lines + 2);
            }
        }
        // In LinuxCNC some comments act.
        let text = "(X)\n(print,1)\n( LOGCLOSE)\n(MESSAGE)\nM2\n";
        let programs = split(text, ControlFamily::LinuxCnc).expect("not too long");
        assert_eq!(programs[0].blocks.len(), 3);
    }

    /// More blocks than memory is given for are refused.
    #[test]
    fn blocks_are_bounded() {
        let fault = split(&"G0\n".repeat(MAX_BLOCKS + 1), ControlFamily::Fanuc);
        assert!(format!("{fault:?}").contains("split the text"));
    }

    /// Numbers are sought forward, then from the beginning; loops may be left, not entered.
    #[test]
    fn jumps() {
        let programs = fanuc("N1\nDO1\nN2\nN1\nEND1\nN3");
        let program = &programs[0];
        assert_eq!(program.find(1, 1), Some(3));
        assert_eq!(program.find(1, 4), Some(0));
        assert_eq!(program.find(9, 0), None);
        assert!(program.may_jump(2, 5));
        assert!(program.may_jump(2, 3));
        assert!(!program.may_jump(0, 2));
    }

    /// Loops overlap, lack an end or nest in themselves: the block is the alarm.
    #[test]
    fn unpaired_loops() {
        for text in [
            "DO1\nDO2\nEND1\nEND2",
            "WHILE[#1EQ1]DO1",
            "END3",
            "DO1\nDO1\nEND1\nEND1",
        ] {
            let programs = fanuc(text);
            let faults = programs[0]
                .blocks
                .iter()
                .filter(|b| b.statement.is_err())
                .count();
            assert!(faults > 0, "{text}");
        }
    }

    /// O words: branches lead to the next one, ends to the begin.
    #[test]
    fn o_words() {
        let programs = split(
            "o1 if [1 EQ 2]\no1 elseif [1]\no1 else\no1 endif\no<a> sub\no<a> endsub\n",
            ControlFamily::LinuxCnc,
        )
        .expect("not too long");
        let program = &programs[0];
        let next: Vec<_> = (0..4).map(|i| program.links[&i].next).collect();
        assert_eq!(next, [1, 2, 3, 3]);
        assert_eq!(program.subs["<a>"], 4);
        assert!(program.blocks.iter().all(|b| b.statement.is_ok()));
        let bad =
            split("o1 while [1]\no2 endwhile", ControlFamily::LinuxCnc).expect("not too long");
        assert!(bad[0].blocks.iter().all(|b| b.statement.is_err()));
    }
}
