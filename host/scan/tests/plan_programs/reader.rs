//! Programs read back, by what the controls' manuals say of their words. It shares nothing with what writes them, and takes
//! no word that it does not know.

use std::collections::BTreeMap;

/// A block that moves axes, and what holds in it.
#[derive(Debug, Clone, Default)]
pub struct Motion {
    /// Its axis words.
    pub words: BTreeMap<String, f64>,
    /// At rapid.
    pub rapid: bool,
    /// Words are of the machine, whatever the work offset (SUPA, M91).
    pub of_machine: bool,
    /// The control carries the point through its rotary axes (TRAORI, M128).
    pub carried: bool,
    /// Seconds that the block takes, where its feed says that (G93).
    pub seconds: Option<f64>,
    /// Feed, mm/min or degrees/min, where it is one.
    pub feed: Option<f64>,
    /// The laser, by the comments before the block.
    pub lit: bool,
}

/// What the comments say of the laser.
fn laser(comment: &str, lit: &mut bool) {
    if comment.contains("LASER ON") {
        *lit = true;
    } else if comment.contains("LASER OFF") {
        *lit = false;
    }
}

fn number(text: &str) -> Result<f64, String> {
    let (_, decimals) = text.split_once('.').ok_or(format!("{text}: no decimals"))?;
    if decimals.len() != 3 {
        return Err(format!("{text}: not three decimals"));
    }
    text.parse().map_err(|_| format!("{text}: no number"))
}

fn put(words: &mut BTreeMap<String, f64>, name: &str, value: f64) -> Result<(), String> {
    match words.insert(name.to_owned(), value) {
        None => Ok(()),
        Some(_) => Err(format!("{name} twice in a block")),
    }
}

/// A program for a Sinumerik.
pub fn siemens(text: &str) -> Result<Vec<Motion>, String> {
    let mut motions = Vec::new();
    let (mut lit, mut ended) = (false, false);
    let (mut metric, mut absolute, mut rapid, mut inverse) = (false, false, None, None);
    let (mut offset, mut carried, mut edge) = (false, false, None);
    for line in text.lines() {
        let (code, comment) = line.split_once(';').unwrap_or((line, ""));
        laser(comment, &mut lit);
        let mut here = Motion::default();
        let mut feed = None;
        for word in code.split_whitespace() {
            if ended {
                return Err(format!("behind M30: {line}"));
            }
            match word {
                "G0" => rapid = Some(true),
                "G1" => rapid = Some(false),
                "G17" | "G40" => {}
                "G54" => offset = true,
                "G71" => metric = true,
                "G90" => absolute = true,
                "G93" => inverse = Some(true),
                "G94" => inverse = Some(false),
                "SUPA" => here.of_machine = true,
                "D0" => edge = Some(false),
                "D1" => edge = Some(true),
                "TRAORI" => carried = true,
                "TRAFOOF" => carried = false,
                "M30" => ended = true,
                _ => {
                    let (name, value) = match word.split_once('=') {
                        // One letter and a number are written together.
                        Some((name, value)) if name.len() > 1 => (name, value),
                        Some(_) => return Err(format!("{word}: an equals sign")),
                        None => word.split_at(1),
                    };
                    let known = name.len() > 1 || "XYZABCUVWF".contains(name);
                    if !known {
                        return Err(format!("{word}: unknown"));
                    }
                    if name == "F" {
                        feed = Some(number(value)?);
                    } else {
                        put(&mut here.words, name, number(value)?)?;
                    }
                }
            }
        }
        if here.words.is_empty() {
            continue;
        }
        if !metric || !absolute {
            return Err(format!("neither G71 nor G90 before: {line}"));
        }
        if !here.of_machine && !offset {
            return Err(format!("no work offset: {line}"));
        }
        if carried && edge != Some(true) {
            return Err(format!("TRAORI without a tool's edge: {line}"));
        }
        here.rapid = rapid.ok_or(format!("neither G0 nor G1: {line}"))?;
        (here.carried, here.lit) = (carried, lit);
        match (here.rapid, inverse, feed) {
            (true, _, None) => {}
            // As many blocks in a minute.
            (false, Some(true), Some(feed)) if feed > 0.0 => here.seconds = Some(60.0 / feed),
            _ => return Err(format!("its feed: {line}")),
        }
        motions.push(here);
    }
    if ended {
        Ok(motions)
    } else {
        Err("no M30".into())
    }
}

/// A program in plain language.
pub fn heidenhain(text: &str) -> Result<Vec<Motion>, String> {
    let lines: Vec<&str> = text.lines().collect();
    let named = |line: &str, word: &str| {
        let rest = line.strip_prefix(word)?.strip_suffix(" MM")?;
        Some(rest.to_owned())
    };
    let [first, inner @ .., last] = lines.as_slice() else {
        return Err("no program".into());
    };
    let name = named(first, "BEGIN PGM ").ok_or("it does not begin in mm")?;
    if named(last, "END PGM ") != Some(name) {
        return Err("it does not end as it begins".into());
    }
    let mut motions = Vec::new();
    let (mut lit, mut ended, mut carried) = (false, false, false);
    for line in inner {
        let (code, comment) = line.split_once(';').unwrap_or((line, ""));
        laser(comment, &mut lit);
        let mut words = code.split_whitespace();
        let Some(kind) = words.next() else { continue };
        if ended {
            return Err(format!("behind M30: {line}"));
        }
        match kind {
            "M128" => carried = true,
            "M129" => carried = false,
            "M30" => ended = true,
            "L" => {
                let mut here = Motion {
                    carried,
                    lit,
                    ..Motion::default()
                };
                let mut corrected = true;
                for word in words {
                    match word {
                        "R0" => corrected = false,
                        "FMAX" => here.rapid = true,
                        "M91" => here.of_machine = true,
                        _ if word.starts_with('F') => {
                            here.feed = Some(word[1..].parse().map_err(|_| word.to_owned())?);
                        }
                        _ => {
                            let (name, value) = word.split_at(1);
                            // Without its sign a number could be read as a distance.
                            if !"XYZABCUVW".contains(name) || !value.starts_with(['+', '-']) {
                                return Err(format!("{word}: unknown"));
                            }
                            put(&mut here.words, name, number(value)?)?;
                        }
                    }
                }
                if corrected || here.words.is_empty() || here.rapid == here.feed.is_some() {
                    return Err(format!("R0, its words or its feed: {line}"));
                }
                motions.push(here);
            }
            _ => return Err(format!("{kind}: unknown")),
        }
    }
    if ended {
        Ok(motions)
    } else {
        Err("no M30".into())
    }
}
