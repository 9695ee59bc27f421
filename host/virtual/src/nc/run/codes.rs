//! Which G codes each dialect has, and which addresses they take.

use super::words::Words;
use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::modal::g_text;
use crate::nc::memory::settings::ControlFamily;

/// Addresses that may stand in any block.
const EVERYWHERE: &str = "NFSTHD";

/// The addresses that a G code (in tenths) takes; none if the dialect does not have it.
pub(crate) fn addresses(tenths: u16, dialect: ControlFamily) -> Option<&'static str> {
    let is_b = dialect.is_macro_b();
    let is_fanuc = matches!(dialect, ControlFamily::Fanuc | ControlFamily::Mitsubishi);
    let is_haas = dialect == ControlFamily::Haas;
    let is_linuxcnc = dialect == ControlFamily::LinuxCnc;
    Some(match tenths {
        0 | 10 => "XYZ",
        20 | 30 if is_linuxcnc => "XYZIJKRP",
        20 | 30 => "XYZIJKR",
        40 if is_b => "PX",
        40 => "P",
        90 if is_b => "",
        100 => "LPXYZR",
        170 | 180 | 190 | 200 | 210 | 400 | 490 | 610 | 900 | 910 | 930 | 940 => "",
        640 if is_linuxcnc => "PQ",
        640 if is_b => "",
        280 if is_b => "XYZ",
        280 => "XYZ",
        300 => "XYZP",
        310 if is_b => "XYZP",
        382..=385 if !is_b => "XYZ",
        // Refused with their own reason.
        410 | 420 | 950 => "XYZ",
        430 if dialect != ControlFamily::Grbl => "Z",
        434 if is_fanuc => "",
        440 if is_b => "Z",
        431 if !is_b => "Z",
        // Cancel codes of functions that are never on.
        150 if is_b => "",
        500 if is_b => "",
        510 if is_b => "XYZPIJK",
        501 | 511 if is_fanuc => "XYZ",
        970 if !matches!(dialect, ControlFamily::Grbl) => "",
        901 if is_linuxcnc => "",
        911 if !is_b => "",
        520 if is_b || is_linuxcnc => "XYZ",
        530 => "XYZ",
        540 if is_fanuc => "P",
        540 | 550 | 560 | 570 | 580 | 590 => "",
        541 if is_fanuc => "P",
        1540 if is_haas => "P",
        591..=593 if is_linuxcnc => "",
        544 if is_fanuc => "P",
        650 | 660 if is_b => "",
        670 if is_b => "",
        680 if is_b => "XYZIJKR",
        690 if is_b => "",
        681 if dialect == ControlFamily::Mitsubishi => "XYZIJKR",
        691 if dialect == ControlFamily::Mitsubishi => "",
        730 | 830 if dialect != ControlFamily::Grbl => "XYZRQLKF",
        810 | 820 | 840 | 850 | 860 | 890 if dialect != ControlFamily::Grbl => "XYZRPLKF",
        800 => "",
        920 => "XYZ",
        921 if !is_b => "",
        980 | 990 if dialect != ControlFamily::Grbl => "",
        1030 if is_haas => "P",
        _ => return None,
    })
}

/// Whether a word of the block beside its work offset takes P: a dwell, a call, a hole.
pub(crate) fn others_take_p(
    mut g: impl Iterator<Item = u16>,
    mut m: impl Iterator<Item = u32>,
    dialect: ControlFamily,
) -> bool {
    g.any(|code| {
        let takes = addresses(code, dialect).is_some_and(|letters| letters.contains('P'));
        takes && !matches!(code, 540 | 541 | 1540)
    }) || m.any(|code| matches!(code, 97 | 98 | 99 | 198))
}

/// Whether a code is one of motion (group 1) or a canned cycle.
pub(crate) const fn is_motion(tenths: u16) -> bool {
    matches!(
        tenths,
        0 | 10 | 20 | 30 | 730 | 810 | 820 | 830 | 840 | 850 | 860 | 890 | 382..=385
    )
}

/// The modal group of a code, by the first of its codes; motions are told apart elsewhere.
const fn group(tenths: u16) -> Option<u16> {
    Some(match tenths {
        170 | 180 | 190 => 170,
        200 | 210 => 200,
        400..=420 => 400,
        540 | 541 | 550 | 560 | 570 | 580 | 590..=593 | 1540 => 540,
        730 | 800 | 810 | 820 | 830 | 840 | 850 | 860 | 890 => 800,
        900 | 910 => 900,
        901 | 911 => 901,
        930 | 940 | 950 => 930,
        980 | 990 => 980,
        _ => return None,
    })
}

/// Checks that a block has no two codes of one modal group, and that no `G90`, `G91`, `G20`,
/// `G21` stands behind a word that it may count for: controls differ in what that means.
///
/// `codes`: G codes in tenths with their places; `first_length`: the first word that is a length.
pub(crate) fn check_groups(codes: &[(u16, usize)], first_length: Option<usize>) -> Checked<()> {
    for (number, (code, at)) in codes.iter().enumerate() {
        let Some(group_of) = group(*code) else {
            continue;
        };
        let before = codes.iter().take(number);
        if let Some((other, _)) = { before }.find(|(other, _)| group(*other) == Some(group_of)) {
            return Err(Fault::new(format!(
                "{} and {} in one block: controls differ in which of them counts; write two blocks",
                g_text(*other),
                g_text(*code)
            ))
            .at(*at));
        }
        if matches!(group_of, 200 | 900) && first_length.is_some_and(|length| length < *at) {
            return Err(Fault::new(format!(
                "{} behind a length: controls differ in whether it counts for that; write it in front",
                g_text(*code)
            ))
            .at(*at));
        }
    }
    Ok(())
}

/// Letters that stand for a length, or an angle that may be an increment.
pub(crate) const LENGTHS: &[u8] = b"XYZIJKRQUVWABC";

/// Whether a code may stand where the control carries the tip through the rotary axes (`G43.4`).
pub(crate) const fn may_carry(tenths: u16) -> bool {
    matches!(
        tenths,
        0 | 10 | 40 | 90 | 434 | 490 | 610 | 640 | 900 | 910 | 930 | 940
    )
}

/// Whether a code uses the axis words for itself.
pub(crate) const fn takes_axes(tenths: u16) -> bool {
    matches!(
        tenths,
        40 | 100 | 280 | 300 | 310 | 382..=385 | 431 | 501 | 510 | 511 | 520 | 680 | 920
    )
}

/// Checks that every word of a block has a meaning in it. `modal` is the motion in force
/// to which axis words belong if no code of the block takes them.
///
/// `rotary`: words of rotary axes, which straight motions take.
pub(crate) fn check(
    words: &Words,
    modal: &[u16],
    dialect: ControlFamily,
    rotary: &str,
) -> Checked<()> {
    let lengths = words.others.iter();
    let lengths = lengths.filter(|given| LENGTHS.contains(&given.letter));
    check_groups(&words.g, lengths.map(|given| given.at).min())?;
    let mut allowed = String::from(EVERYWHERE);
    let mut takers = Vec::new();
    let mut motions = Vec::new();
    for (code, at) in &words.g {
        let Some(letters) = addresses(*code, dialect) else {
            return Err(Fault::ps(
                10,
                format!("{} is not a code of this control", g_text(*code)),
            )
            .at(*at));
        };
        allowed.push_str(letters);
        if takes_axes(*code) {
            takers.push(*code);
        }
        if is_motion(*code) {
            motions.push(*code);
        }
    }
    for codes in [&mut takers, &mut motions] {
        codes.dedup();
        if let [first, second, ..] = codes.as_slice() {
            return Err(Fault::new(format!(
                "{} and {} in one block: write two",
                g_text(*first),
                g_text(*second)
            )));
        }
    }
    let in_force = if motions.is_empty() { modal } else { &motions };
    if takers.is_empty() && in_force.iter().all(|code| matches!(code, 0 | 10)) {
        allowed.push_str(rotary);
    }
    if takers.is_empty() && motions.is_empty() {
        for code in modal {
            allowed.push_str(addresses(*code, dialect).unwrap_or_default());
        }
    }
    for (code, _) in &words.m {
        allowed.push_str(match code {
            97 | 98 | 198 => "PL",
            99 => "PL",
            50 if dialect == ControlFamily::LinuxCnc => "P",
            66 if dialect == ControlFamily::LinuxCnc => "PELQ",
            // Orientation of the spindle to an angle (Haas).
            19 if dialect == ControlFamily::Haas => "PR",
            _ => "",
        });
    }
    for given in &words.others {
        if !allowed.contains(given.letter as char) {
            return Err(Fault::ps(
                9,
                format!(
                    "{} has no meaning in this block: remove it",
                    given.letter as char
                ),
            )
            .at(given.at));
        }
    }
    Ok(())
}
