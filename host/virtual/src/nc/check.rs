//! A control's alarms, found in a program's text without running it.

use crate::nc::memory::alarm::{Alarm, Fault, Severity};
use crate::nc::memory::modal::g_text;
use crate::nc::memory::offsets::MAX_EXTENDED;
use crate::nc::memory::settings::{ControlFamily, ControlSettings};
use crate::nc::run::codes;
use crate::nc::run::control::{Control, comes_twice, read};
use crate::nc::run::words::AXES;
use crate::nc::text::block::{Block, Statement, Word};
use crate::nc::text::evaluate::whole;
use crate::nc::text::oword::Flow;
use crate::nc::text::program::Program;

mod flow;
mod values;

/// M codes that mean much the same on most machines: stops, ends, spindle, coolant, tool
/// change, clamps, orientation, rigid tapping, gears, overrides.
const USUAL_M: [u32; 29] = [
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 14, 19, 29, 30, 40, 41, 42, 43, 44, 48, 49, 60, 97,
    98, 99, 198,
];

/// Reads a text as a control does as it runs through all blocks, without values: syntax,
/// unknown codes and words, loops without an end, jumps to nowhere; as warnings calls to
/// programs that are not in this text, and what not every control takes.
#[must_use]
pub fn check(text: &str, settings: &ControlSettings) -> Vec<Alarm> {
    let mut found = Vec::new();
    let programs = match read(text, settings) {
        Ok(programs) => programs,
        Err(fault) => {
            found.push(fault.in_block(settings.dialect, 0, 0, ""));
            return found;
        }
    };
    let line = |program: &Program| program.blocks.first().map_or(0, |block| block.line);
    if programs.len() > settings.limits.programs {
        let fault = Fault::new(format!(
            "{} programs: the control holds {}",
            programs.len(),
            settings.limits.programs
        ));
        found.push(fault.in_block(settings.dialect, 0, 0, ""));
    }
    // What a control holds before a program is run: what can be set and read.
    let mut control = Control::new(settings.clone());
    let mut calls = flow::Calls::new(&programs);
    for program in &programs {
        let is_twin = |other: &&Program| other.number == program.number && !other.is_library();
        if !program.is_library() && programs.iter().filter(is_twin).count() > 1 {
            found.push(comes_twice(program.number).in_block(
                settings.dialect,
                program.number,
                line(program),
                "",
            ));
        }
        for (at, text, fault) in flow::faults(&mut calls, program, settings) {
            found.push(fault.in_block(settings.dialect, program.number, at, text));
        }
        for (index, block) in program.blocks.iter().enumerate() {
            let mut faults = faults(&programs, program, index, block, settings);
            if let Ok(statement) = &block.statement {
                values::check(statement, &mut control, &mut faults);
            }
            for fault in faults {
                found.push(fault.in_block(
                    settings.dialect,
                    program.number,
                    block.line,
                    &block.text,
                ));
            }
        }
        if !has_end(program, settings.dialect) {
            found.push(
                Fault::warning("no M30, M2 or M99 in this program: it ends with an alarm")
                    .in_block(settings.dialect, program.number, line(program), ""),
            );
        }
    }
    found.sort_by_key(|alarm| (alarm.line, alarm.severity == Severity::Warning));
    found
}

fn faults(
    programs: &[Program],
    program: &Program,
    index: usize,
    block: &Block,
    settings: &ControlSettings,
) -> Vec<Fault> {
    let mut faults = block.warnings.clone();
    let statement = match &block.statement {
        Ok(statement) => statement,
        Err(fault) => {
            faults.push(fault.clone());
            return faults;
        }
    };
    if let Some(value) = Program::target_of(statement) {
        match whole(value, 99_999_999).map(|n| (n, program.find(n, index + 1))) {
            Some((_, Some(to))) if program.may_jump(index, to) => {}
            Some((n, Some(_))) => faults.push(Fault::new(format!(
                "N{n} stands inside a loop: GOTO cannot lead into one"
            ))),
            _ => faults.push(Fault::ps(128, format!("no block N{value} in this program"))),
        }
    }
    match statement {
        Statement::Words(words, _) => check_words(programs, program, words, settings, &mut faults),
        Statement::OWord(word) => {
            let is_known = programs
                .iter()
                .any(|program| program.subs.contains_key(&word.label));
            if matches!(word.flow, Flow::Call(_)) && !is_known {
                faults.push(Fault::warning(format!(
                    "o{} is not in this text: load it, too",
                    word.label
                )));
            }
        }
        _ => {}
    }
    faults
}

fn check_words(
    programs: &[Program],
    program: &Program,
    words: &[Word],
    settings: &ControlSettings,
    faults: &mut Vec<Fault>,
) {
    let dialect = settings.dialect;
    let code = |word: &Word| {
        word.value
            .constant()
            .and_then(|value| whole(value * 10.0, 9999))
            .and_then(|code| u16::try_from(code).ok())
    };
    let is_macro_call = dialect.is_macro_b()
        && words
            .first()
            .is_some_and(|word| word.letter == b'G' && matches!(code(word), Some(650 | 660)));
    if is_macro_call {
        check_call(programs, words, faults);
        return;
    }
    let mut motions = Vec::new();
    for word in words {
        if word.letter != b'G' {
            continue;
        }
        match code(word) {
            None if word.value.constant().is_none() => {}
            Some(code) if codes::addresses(code, dialect).is_some() => {
                if codes::is_motion(code) {
                    motions.push(code);
                }
                if matches!(code, 410 | 420 | 950) {
                    faults.push(
                        Fault::new(format!("{} is not interpreted", g_text(code))).at(word.at),
                    );
                }
            }
            Some(code) => faults.push(
                Fault::ps(
                    10,
                    format!("{} is not a code of this control", g_text(code)),
                )
                .at(word.at),
            ),
            None => faults.push(Fault::ps(10, "no G code").at(word.at)),
        }
    }
    if let [first, second, ..] = motions.as_slice() {
        faults.push(Fault::new(format!(
            "{} and {} in one block: write two",
            g_text(*first),
            g_text(*second)
        )));
    }
    let g = words.iter().filter(|word| word.letter == b'G');
    let g: Vec<_> = g.filter_map(|word| Some((code(word)?, word.at))).collect();
    let lengths = words
        .iter()
        .filter(|word| codes::LENGTHS.contains(&word.letter));
    if let Err(fault) = codes::check_groups(&g, lengths.map(|word| word.at).min()) {
        faults.push(fault);
    }
    check_letters(words, &settings.rotary_words, faults);
    codes_with_values(words, dialect, faults);
    let m = words
        .iter()
        .find(|word| word.letter == b'M')
        .and_then(|word| word.value.constant())
        .and_then(|value| whole(value, 9999));
    let p = words
        .iter()
        .find(|word| word.letter == b'P')
        .and_then(|word| word.value.constant())
        .and_then(|value| whole(value, 99_999_999));
    match (m, p) {
        (Some(198), _) => faults.push(Fault::warning(
            "M198 reads its program from an external device: there must be one",
        )),
        (Some(98), Some(p)) => {
            let has = |number: u32| programs.iter().any(|program| program.number == number);
            if !has(p) && !has(p % 10_000) {
                faults.push(Fault::warning(format!(
                    "O{:04} is not in this text: load it, too",
                    p % 10_000
                )));
            }
        }
        (Some(98), None) if !words.iter().any(|word| word.letter == b'P') => {
            faults.push(Fault::ps(76, "M98 needs P"));
        }
        (Some(97), Some(p)) if program.find(p, 0).is_none() => {
            faults.push(Fault::ps(78, format!("no block N{p} in this program")));
        }
        _ => {}
    }
}

/// Codes whose P, or whose lack of axes, a control refuses; M codes that few machines have.
fn codes_with_values(words: &[Word], dialect: ControlFamily, faults: &mut Vec<Fault>) {
    let is_b = dialect.is_macro_b();
    let find = |letter: u8| words.iter().find(|word| word.letter == letter);
    // The whole number behind a letter; none if it is not written there.
    let number = |letter: u8| {
        find(letter)
            .and_then(|word| word.value.constant())
            .and_then(|value| whole(value, 99_999_999))
    };
    let has_axes = AXES.iter().any(|axis| find(*axis).is_some());
    let others_take_p = || {
        let of = |letter: u8, times: f64| {
            let these = words.iter().filter(move |word| word.letter == letter);
            let values = these.filter_map(|word| word.value.constant());
            values.filter_map(move |value| whole(value * times, 9999))
        };
        let g = of(b'G', 10.0).filter_map(|code| u16::try_from(code).ok());
        codes::others_take_p(g, of(b'M', 1.0), dialect)
    };
    for word in words {
        let Some(value) = word.value.constant() else {
            continue;
        };
        if word.letter == b'M' {
            match whole(value, 9999) {
                Some(m) if USUAL_M.contains(&m) => {}
                Some(m) => faults.push(
                    Fault::warning(format!(
                        "M{m} is the machine builder's own: here it does nothing"
                    ))
                    .at(word.at),
                ),
                None => faults.push(Fault::new(format!("M{value} is no M code")).at(word.at)),
            }
        }
        if word.letter != b'G' {
            continue;
        }
        let code = whole(value * 10.0, 9999).unwrap_or_default();
        // The code, its L, and the largest P it takes from the least on.
        let range = match (code, number(b'L')) {
            (310, _) | (382..=385, _) if !has_axes => {
                faults.push(Fault::new(format!("G{value} needs X, Y or Z")).at(word.at));
                continue;
            }
            (100, Some(2)) => Some((
                0,
                if dialect == ControlFamily::LinuxCnc {
                    9
                } else {
                    6
                },
            )),
            (100, Some(20)) if is_b => Some((1, u32::from(MAX_EXTENDED))),
            (100, Some(20)) => Some((0, 9)),
            (540, _) if others_take_p() => None,
            (540 | 541 | 1540, _) => Some((1, u32::from(MAX_EXTENDED))),
            (544, _) => Some((0, 7)),
            _ => None,
        };
        if let (Some((least, most)), Some(p)) = (range, find(b'P'))
            && let Some(value) = p.value.constant()
            && whole(value, most).is_none_or(|p| p < least)
        {
            faults.push(
                Fault::ps(31, format!("P{value}: P is from {least} to {most} here")).at(p.at),
            );
        }
    }
}

/// Letters that nothing in the block takes, whatever motion is in force.
fn check_letters(words: &[Word], rotary: &str, faults: &mut Vec<Fault>) {
    for (index, word) in words.iter().enumerate() {
        if matches!(word.letter, b'G' | b'M') {
            continue;
        }
        let name = word.letter as char;
        let is_known =
            b"NFSTHDXYZIJKRPLQ".contains(&word.letter) || rotary.as_bytes().contains(&word.letter);
        if !is_known {
            faults.push(
                Fault::ps(9, format!("this control has no address {name}: remove it")).at(word.at),
            );
        } else if words
            .iter()
            .take(index)
            .any(|other| other.letter == word.letter)
        {
            faults.push(Fault::new(format!("{name} comes twice in this block")).at(word.at));
        }
    }
}

fn check_call(programs: &[Program], words: &[Word], faults: &mut Vec<Fault>) {
    let mut target = None;
    for word in words.iter().skip(1) {
        match word.letter {
            b'P' => target = Some(word),
            b'G' | b'N' | b'O' => faults.push(
                Fault::ps(
                    129,
                    format!("{} cannot be an argument of a macro", word.letter as char),
                )
                .at(word.at),
            ),
            _ => {}
        }
    }
    match target.map(|word| word.value.constant().and_then(|v| whole(v, 99_999_999))) {
        None => faults.push(Fault::ps(76, "G65 and G66 need P, the number of the macro")),
        Some(Some(p)) if !programs.iter().any(|program| program.number == p) => faults.push(
            Fault::warning(format!("O{p:04} is not in this text: load it, too")),
        ),
        Some(_) => {}
    }
}

/// Whether a program says anywhere that it ends.
fn has_end(program: &Program, dialect: ControlFamily) -> bool {
    !dialect.is_macro_b()
        || program.blocks.iter().any(|block| {
            match &block.statement {
        Ok(Statement::Words(words, _)) => words.iter().any(|word| {
            word.letter == b'M'
                && matches!(word.value.constant(), Some(m) if m == 2.0 || m == 30.0 || m == 99.0)
        }),
        _ => false,
    }
        })
}
