//! What a control would complain about, without running.

use super::alarm::{Alarm, Fault, Severity};
use super::block::{Block, Statement, Word};
use super::codes;
use super::control::Control;
use super::evaluate::whole;
use super::modal::g_text;
use super::oword::Flow;
use super::program::{Program, split};
use super::settings::{Dialect, Settings};

/// Reads a text as a control does as it runs through all blocks, without values: syntax,
/// unknown codes and words, loops without an end, jumps to nowhere; as warnings calls to
/// programs that are not in this text, and what not every control takes.
#[must_use]
pub fn check(text: &str, settings: &Settings) -> Vec<Alarm> {
    let mut control = Control::new(settings.clone());
    let mut found = Vec::new();
    if let Err(alarm) = control.load(text) {
        found.push(alarm);
        return found;
    }
    let programs = split(text, settings.dialect);
    for program in &programs {
        for (index, block) in program.blocks.iter().enumerate() {
            for fault in faults(&programs, program, index, block, settings) {
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
                    .in_block(settings.dialect, program.number, 0, ""),
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
    settings: &Settings,
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
    settings: &Settings,
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
                if matches!(code, 410 | 420 | 930 | 950) {
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
    check_letters(words, faults);
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
        (Some(198), _) => faults.push(Fault::new("M198: there is no external device")),
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

/// Letters that nothing in the block takes, whatever motion is in force.
fn check_letters(words: &[Word], faults: &mut Vec<Fault>) {
    for (index, word) in words.iter().enumerate() {
        if matches!(word.letter, b'G' | b'M') {
            continue;
        }
        let name = word.letter as char;
        let is_known = b"NFSTHDXYZIJKRPLQ".contains(&word.letter);
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
fn has_end(program: &Program, dialect: Dialect) -> bool {
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
