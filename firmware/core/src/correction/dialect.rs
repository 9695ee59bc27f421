//! The table of dialects: what each control can express, in which numbers, by which words.
//!
//! # One table, one writer
//!
//! A dialect is one [`Form`]: how it turns, the steps of its numbers, where it can write, and
//! its program as a text with keys, which [`super::write()`] fills in.
//!
//! | key | is replaced by |
//! | --- | --- |
//! | `{x}` `{y}` `{z}` | the new origin, or the set's shift |
//! | `{o}` `{p}` `{q}` | the origin that was probed with |
//! | `{u}` `{v}` | the point about which `G68` turns |
//! | `{i}` `{j}` `{k}` | the axis, its largest component 1000 |
//! | `{a}` `{b}` `{c}` | the angles about X, Y, Z; `{c}` alone where there is only one |
//! | `{w}` `{f}` | the work offset that is written; that was probed in |
//! | `{g}` `{n}` `{N}` | its `G10 L P`; its number; its number, 100 more beyond G59 |
//! | `{X}` `{Y}` `{Z}` | the numbers of its variables |
//! | `{t}` | what is not as it should be of offset, plane, G90, G21, tool length and cycle in force |
//! | `{0}` to `{9}` | common variables, counted from the first |
//! | `{s}` `{m}` `{e}` | the set; the program number; `M99` or `M30` |
//! | `{h}` `{H}` | the check value; with the offset's number in it |
//! | `{#}` | what the verdict said, as comments |
//! | `{?}` | an alarm if the control is in another run than the one that was measured |
//! | `^a\|b^` | `a` in a subprogram (`M99`), `b` in a main program (`M30`) |
//!
//! The check value is `1·x + 2·y + 3·z + 4·u + 5·v + 6·c` (`a`, `b` in place of `u`, `v` where
//! there are three angles; `+ 7·N`, or `+ 7·o + 8·p + 9·q` where the shift is in a set), so exchanged
//! values show in it as wrong digits do.
//!
//! # A wrong digit on the way to the control
//!
//! Programs that the control can hold to what they say read back what it has stored, and which codes
//! are in force, and compare that with the check value: a second copy of all. What cannot be read
//! back, the angle of `G68` and the number of a set, comes from `#33`; the local variables whose
//! numbers differ from 33 by one digit (3, 13, 23, 30 to 32) hold the same, and all others of that
//! kind are variables of no control. So no single digit changes it. The centre is a difference of
//! it with itself.
//!
//! # What stands behind each
//!
//! Sources are named in [`about`]. "Read" means that a page of the maker or an unchanged
//! public program shows it; what was only known is called so. No dialect has been on a
//! control yet. Those of Fanuc, Haas, LinuxCNC and GRBL run in the virtual machine's
//! interpreter, LinuxCNC's also in LinuxCNC's own. The values of Mazak's and Mitsubishi's
//! sets have no public variable: their programs stop and ask the operator to key them in.
//!
//! # Left out
//!
//! Haas' offset file (`%`, `N1 V…`, `%`; operator's manual 96-8000, June 1999, page 115): its
//! frame is public, which N belongs to which offset is not. `G10 L50`: it writes
//! parameters, and a wrong number there does more than move a part. `G52`, `G92`: they do not
//! survive a reset. `G254`: it needs rotary axes.

use umi_protocol::job::{CorrectionSpec, Dialect, WorkOffset};
use umi_protocol::job_error::Field;

/// How a control can turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// Not at all.
    No,
    /// About Z, through a point that is given.
    Point,
    /// About Z, through the origin of the work offset.
    Origin,
    /// About any axis through the origin.
    Axis,
    /// About X, then Y, then Z, axes that stay; the same as Z, Y', X'' of axes that turn.
    Angles,
}

/// A dialect's numbers and words.
#[derive(Clone, Copy, Debug)]
pub struct Form {
    /// How it turns.
    pub turn: Turn,
    /// A main program's end resets the rotation: only a subprogram can leave it on.
    pub turn_ends_with_program: bool,
    /// The shift is counted from the work offset, which is written as it was probed with.
    pub in_set: bool,
    /// Decimals of a length in mm.
    pub decimals_mm: u8,
    /// Decimals of an angle in degrees.
    pub decimals_deg: u8,
    /// Largest length that the control takes.
    pub limit_mm: f64,
    /// How many of G54 to G59 it has; none: they mean nothing to it.
    pub standard: u16,
    /// What stands before the number of a further work offset, how many digits it has, and
    /// from where to where it goes.
    pub further: Option<(&'static str, u8, u16, u16)>,
    /// The set, row or first variable: from where to where, and which if none is given.
    pub set: Option<(u16, u16, u16)>,
    /// What begins and ends a comment.
    pub comment: (&'static str, &'static str),
    /// The program.
    pub program: &'static str,
}

/// The head of programs in the manner of Fanuc.
macro_rules! head {
    () => {
        "%\nO{m}(UMI CORRECTION {w})\n{#}({f} WAS X{o} Y{p} Z{q} - RUN WITH {w})\n{?}"
    };
}

/// What `G68` leaves behind.
macro_rules! note {
    () => {
        "(^LEAVES G17 G21 G90 G68 ACTIVE - CALLER MUST NOT G69|OFFSET ONLY^)\nG17 G21 G90\nG69\n"
    };
}

/// The program that has written its offset and turns in the plane, or not.
macro_rules! plane {
    () => {
        "{w}\n^G68 X{u} Y{v} R{c}\n|^{e}\n%\n"
    };
}

/// `#33` under each number that one wrong digit makes of it.
macro_rules! alike {
    () => {
        "\n#3=#33\n#13=#33\n#23=#33\n#30=#33\n#31=#33\n#32=#33\n"
    };
}

/// The end of a program that holds the control to it.
macro_rules! held {
    () => {
        "GT0.0005]GOTO9\n{e}\nN9#3000=1(UMI CORRECTION NOT STORED)\n%\n"
    };
}

/// Values that are keyed in by hand.
macro_rules! by_hand {
    () => {
        "(SET {s} X{x} Y{y} Z{z})\n(SET {s} A{a} B{b} C{c})\n(RUN WITH G54.4 P{s})\nG17 G21 G90\n\
         G69\nG54.4 P0\n{g} X{o} Y{p} Z{q}\n#3006=1(KEY IN SET {s} FROM COMMENTS)\n{w}\n{e}\n%\n"
    };
}

/// In the manner of Fanuc, IS-B: 0.001 mm, 0.001 degree, five integer digits.
const FANUC: Form = Form {
    turn: Turn::Point,
    turn_ends_with_program: true,
    in_set: false,
    decimals_mm: 3,
    decimals_deg: 3,
    limit_mm: 99_999.0,
    standard: 6,
    further: Some(("G54.1 P", 1, 1, 300)),
    set: None,
    comment: ("(", ")\n"),
    program: concat!(head!(), note!(), "{g} X{x} Y{y} Z{z}\n", plane!()),
};

/// The same by variables, read back.
const VARIABLES: Form = Form {
    turn: Turn::Origin,
    program: concat!(
        head!(),
        "#9=#4008\n",
        note!(),
        "#{X}={x}\n#{Y}={y}\n#{Z}={z}\n^#33={c}",
        alike!(),
        "|^IF[#4016NE69]GOTO9\n{w}\n^G68 X[#33-#33] Y[#33-#33] R[#33-#33+#33]\n|^IF[ABS[#{X}+2*#{Y}+\
         3*#{Z}^+6*#33|^-[{h}]]+{t}+ABS[#4016-^68|69^]",
        held!()
    ),
    ..FANUC
};

/// A set of `G54.4`.
const SETTING_ERROR: Form = Form {
    turn: Turn::Angles,
    turn_ends_with_program: false,
    in_set: true,
    set: Some((1, 7, 1)),
    program: concat!(head!(), by_hand!()),
    ..FANUC
};

/// The form of a dialect.
#[must_use]
pub const fn form(dialect: Dialect) -> Form {
    match dialect {
        Dialect::G10G68 => FANUC,
        Dialect::G68ThreeD => Form {
            turn: Turn::Axis,
            program: concat!(
                head!(),
                note!(),
                "{g} X{x} Y{y} Z{z}\n{w}\n^G68 X0. Y0. Z0. I{i} J{j} K{k} R{c}\n|^{e}\n%\n"
            ),
            ..FANUC
        },
        Dialect::FanucSettingError => Form {
            // The sets are #26000 and on, ten apart; set 0 is added to all others.
            program: concat!(
                head!(),
                "#9=#4008\n(^LEAVES G17 G21 G90 G54.4 ACTIVE|RUN WITH G54.4 P{s}^)\nG17 G21 G90\nG69\n\
                 G54.4 P0\n#{X}={o}\n#{Y}={p}\n#{Z}={q}\n#260{s}0={x}\n#260{s}1={y}\n#260{s}2={z}\n\
                 #260{s}3={a}\n#260{s}4={b}\n#260{s}5={c}\nIF[ABS[#26000]+\
                 ABS[#26001]+ABS[#26002]+ABS[#26003]+ABS[#26004]+ABS[#26005]GT0]GOTO9\n#33={s}",
                alike!(),
                "{w}\n^G54.4 P#33\n|^IF[ABS[#260{s}0+2*#260{s}1+3*#260{s}2\
                 +4*#260{s}3+5*#260{s}4+6*#260{s}5+7*#{X}+8*#{Y}+9*#{Z}-[{h}]]+{t}+ABS[#4016-69]+\
                 ABS[#33-{s}]",
                held!()
            ),
            ..SETTING_ERROR
        },
        Dialect::MazakSettingError | Dialect::MitsubishiSettingError => SETTING_ERROR,
        Dialect::Variables => VARIABLES,
        Dialect::Haas => Form {
            further: Some(("G154 P", 1, 1, 99)),
            ..VARIABLES
        },
        Dialect::HaasVariables => Form {
            further: Some(("G154 P", 1, 1, 99)),
            // The macro turns, whatever the job says of an end. It looks here:
            turn_ends_with_program: false,
            set: Some((150, 150, 150)),
            program: "E{0} {x}\nE{1} {y}\nE{2} {z}\nE{3} {u}\nE{4} {v}\nE{5} {c}\nE{6} {N}.\nE{8} {r}.\n\
                      E{7} {H}\n",
            ..FANUC
        },
        Dialect::Siemens => Form {
            turn: Turn::Angles,
            turn_ends_with_program: false,
            standard: 4,
            further: Some(("G5", 2, 5, 99)),
            comment: ("; ", "\n"),
            program: "%_N_UMI{m}_SPF\n;$PATH=/_N_SPF_DIR\n; UMI CORRECTION {w}\n{#}\
                      ; {f} WAS X{o} Y{p} Z{q} - RUN WITH {w}\n{?}G17 G71 G90\n\
                      $P_UIFR[{n}]=CTRANS(X,{x},Y,{y},Z,{z}):CROT(X,{a},Y,{b},Z,{c})\n\
                      {w}\n^M17|M30^\n",
            ..FANUC
        },
        Dialect::Heidenhain => Form {
            turn: Turn::Angles,
            turn_ends_with_program: false,
            decimals_mm: 4,
            decimals_deg: 4,
            standard: 6,
            further: None,
            set: Some((1, 9999, 1)),
            comment: ("; ", "\n"),
            program: "BEGIN PGM UMI{m} MM\n; UMI CORRECTION PRESET {s}\n{#}\
                      ; PRESET WAS X{o} Y{p} Z{q} - RUN WITH PRESET {s}\n{?}\
                      FN 17: SYSWRITE ID 507 NR{s} IDX1 = {x}\nFN 17: SYSWRITE ID 507 NR{s} IDX2 = {y}\n\
                      FN 17: SYSWRITE ID 507 NR{s} IDX3 = {z}\nFN 17: SYSWRITE ID 507 NR{s} IDX4 = {a}\n\
                      FN 17: SYSWRITE ID 507 NR{s} IDX5 = {b}\nFN 17: SYSWRITE ID 507 NR{s} IDX6 = {c}\n\
                      CYCL DEF 247 DATUM SETTING ~\n  Q339={s} ;DATUM NUMBER\nEND PGM UMI{m} MM\n",
            ..FANUC
        },
        Dialect::LinuxCnc => Form {
            // One block: a G28 or G30 by a wrong digit beside G10 is an error, not a move. The offsets
            // (#5221 on) are in the machine's units, mm or inches.
            turn: Turn::Origin,
            turn_ends_with_program: false,
            decimals_mm: 4,
            decimals_deg: 6,
            further: None,
            program: "^o<umi_correction> sub\n|^(UMI CORRECTION {w})\n{#}\
                      ({f} WAS X{o} Y{p} Z{q} - RUN WITH {w})\n{?}G17 G21 G90 \
                      G10 L2 P{n} X{x} Y{y} Z{z} R{c}\n{w}\n#1=[[{x}]+2*[{y}]+3*[{z}]]\n\
                      #2=[#{X}+2*#{Y}+3*#{Z}]\no532 if [ABS[#2-#1] GT 0.00005]\n#2=[25.4*#2]\n\
                      o532 endif\n#2=[ABS[#2-#1]+99*ABS[#{R}-[{c}]]+ABS[#5220-{n}]+ABS[#<_metric>-1]]\n\
                      o533 if [#2 GT 0.00005]\n(ABORT, UMI CORRECTION NOT STORED)\no533 endif\n\
                      ^o<umi_correction> endsub\nM2|M30^\n",
            ..FANUC
        },
        Dialect::Grbl => Form {
            turn: Turn::No,
            turn_ends_with_program: false,
            // It counts in single precision: to 1 m within 0.00003 mm.
            limit_mm: 1000.0,
            further: None,
            program: "(UMI CORRECTION {w})\n{#}({f} WAS X{o} Y{p} Z{q} - RUN WITH {w})\nG21 G90\n\
                      G10 L2 P{n} X{x} Y{y} Z{z}\n{w}\n",
            ..FANUC
        },
    }
}

impl Form {
    /// The set that is written, where it writes one.
    #[must_use]
    pub fn set(&self, spec: &CorrectionSpec) -> u16 {
        let default = self.set.map_or(0, |(_, _, default)| default);
        spec.set.unwrap_or(default)
    }

    fn has(&self, offset: WorkOffset) -> bool {
        let number = offset.p_number();
        match (offset, self.further) {
            (WorkOffset::Extended(_), Some((_, _, first, last))) => {
                (first..=last).contains(&number)
            }
            (WorkOffset::Extended(_), None) => false,
            _ => number <= self.standard,
        }
    }
}

/// Whether a correction can compare the run that was measured with the control's own.
///
/// Not with GRBL, which has no variables. With `haas-e` the macro O8830 compares, in `#531`. For
/// Siemens and Heidenhain there are no macros of ours that count runs: the part program's own
/// must, and print the lines.
#[must_use]
pub const fn compares_runs(dialect: Dialect) -> bool {
    !matches!(dialect, Dialect::Grbl)
}

/// Whether the tape code EIA (RS-244), which has letters, digits and few signs, has all that a correction of this dialect is
/// made of.
#[must_use]
pub const fn eia_carries(dialect: Dialect, compares: bool) -> bool {
    match dialect {
        Dialect::HaasVariables | Dialect::Grbl => true,
        Dialect::G10G68 | Dialect::G68ThreeD => !compares,
        _ => false,
    }
}

/// Whether a rewritten part program can: those that are rewritten are of Fanuc's manner, or
/// LinuxCNC's.
#[must_use]
pub const fn programs_compare_runs(dialect: Dialect) -> bool {
    !matches!(
        dialect,
        Dialect::Grbl | Dialect::Siemens | Dialect::Heidenhain
    )
}

/// Whether a control of this dialect can count runs in this variable: a common one that it keeps
/// while it is switched off. Local ones end with their program, the common ones from 100 to 199
/// with the power (not a Haas'), and what lies beyond is the control's own.
///
/// LinuxCNC keeps what its parameter file lists. Sources: Fanuc 16i B-63014EN 15.1 (#1 to #33
/// local, #100 to #199 common and cleared, #500 to #999 common and kept, #1000 on system
/// variables) as known; Haas NGC's #100 to #199, #500 to #999, #10000 to #10999, as known;
/// LinuxCNC's "Numbered Parameters" (31 to 5000 are the user's); Siemens' R parameters (MD28050
/// says how many there are) and Heidenhain's QR0 to QR499, which both keep, as known.
#[must_use]
pub const fn keeps_runs(dialect: Dialect, variable: u32) -> bool {
    match dialect {
        Dialect::LinuxCnc => matches!(variable, 31..=5000),
        Dialect::Haas => matches!(variable, 100..=199 | 500..=999 | 10_000..=10_999),
        // O8830 knows no other one.
        Dialect::HaasVariables => variable == 531,
        Dialect::Siemens => variable <= 999,
        Dialect::Heidenhain => variable <= 499,
        Dialect::G10G68
        | Dialect::G68ThreeD
        | Dialect::FanucSettingError
        | Dialect::MazakSettingError
        | Dialect::MitsubishiSettingError
        | Dialect::Variables
        | Dialect::Grbl => matches!(variable, 500..=999 | 98_000..=98_499),
    }
}

/// Whether a correction holds the control to every digit of it: in `haas-e` the macro O8830 does, the
/// others read back what was stored.
#[must_use]
pub const fn is_read_back(dialect: Dialect) -> bool {
    matches!(
        dialect,
        Dialect::HaasVariables
            | Dialect::Haas
            | Dialect::Variables
            | Dialect::FanucSettingError
            | Dialect::LinuxCnc
    )
}

/// Whether the dialect can write where the job wants it.
///
/// # Errors
/// The field that names a place that it does not have.
pub fn check(spec: &CorrectionSpec) -> Result<(), Field> {
    let form = form(spec.dialect);
    if !form.has(spec.write_to) || !form.has(spec.probed_in) {
        return Err(Field::WriteTo);
    }
    match (spec.set, form.set) {
        (None, _) => Ok(()),
        (Some(set), Some((first, last, _))) if (first..=last).contains(&set) => Ok(()),
        (Some(_), _) => Err(Field::Set),
    }
}

/// What people want to know of a dialect.
#[derive(Clone, Copy, Debug)]
pub struct About {
    /// Controls that have it, and the option that it needs.
    pub controls: &'static str,
    /// What has run its programs.
    pub tried: &'static str,
    /// Where its format is from.
    pub sources: &'static str,
}

/// The words about a dialect. Firmware does not use them, so they are not in it.
#[must_use]
pub const fn about(dialect: Dialect) -> About {
    let (controls, tried, sources) = match dialect {
        Dialect::G10G68 => (
            "Fanuc, Mitsubishi, Mazak EIA, Brother; G68 is an option on some",
            "virtual machine; its moves by LinuxCNC's interpreter",
            "Fanuc 15i B-63324EN/03 14.9 (G68: centre, R in 0.001 or 0.00001 degree); Mitsubishi M700V 12.7 (G10 L2, L20)",
        ),
        Dialect::G68ThreeD => (
            "Fanuc 16 to 30i, Mitsubishi M700V; option, three-dimensional coordinate conversion",
            "virtual machine",
            "Fanuc 16-C B-62764EN/01 page 243 (I, J, K and R all needed, else alarm 5044; X Y Z absolute); Fanuc 15i B-63324EN/03 13.9 (R in 0.001 degree); Mitsubishi M700V 13.23",
        ),
        Dialect::FanucSettingError => (
            "Fanuc 30i, 31i; option, workpiece setting error compensation; 11200#0 RCM = 0 corrects positions only",
            "virtual machine",
            "Fanuc A-79634E (G54.4 P, sets 1 to 7, common set 0 added); variables #26010 to #26015 as public Fanuc post processors write them; that they go on ten by set, and the order X, Y, Z of the angles (read for Mazak) is taken over: not read for Fanuc",
        ),
        Dialect::MazakSettingError => (
            "Mazak Matrix, Smooth; option, workpiece setup error correction",
            "virtual machine, values keyed in from the comments",
            "Mazak five-axis functions 26-4 (G54.4 alone in its block, P0 to P7; shift absolute in the work offset; angles about X, Y, Z in this order, right-handed)",
        ),
        Dialect::MitsubishiSettingError => (
            "Mitsubishi M700V, M800; option, workpiece installation error compensation",
            "virtual machine, values keyed in from the comments",
            "known to have G54.4; that its angles are Mazak's is taken over, not read",
        ),
        Dialect::Variables => (
            "Fanuc, Mitsubishi, Mazak EIA: with macros; read back; writes #3 #9 #13 #23 #30 to #33",
            "virtual machine",
            "Haas 96-8000 page 113 (#5221 to #5325 G54 to G59, #7001 on the further ones, 20 apart); modal #4002 to #4016, #4130 as known",
        ),
        Dialect::Haas => (
            "Haas with macros; G68 is an option (rotation and scaling); read back; writes #3 #9 #13 #23 #30 to #33",
            "virtual machine",
            "Haas mill operator's manual, G68 (R three decimals, -360 to 360); 96-8000 page 113 (#5221 to #5325, #7001 on); #14401 on (G154 P21 on), #4012 as known",
        ),
        Dialect::HaasVariables => (
            "Haas with macros and setting 143 on, and the macro O8830 of hw/control/haas",
            "virtual machine, the E lines as assignments",
            "E, number of the variable, value: from users of setting 143 on the serial port; never seen on a line",
        ),
        Dialect::Siemens => (
            "Sinumerik 828D, 840D",
            "an independent computation; no control and no interpreter",
            "Siemens K2 6FC5397-0BP10-2BA0 2.4 (MD10600 = 1: RPY, Z, Y', X''; Y less than 90 degrees); $P_UIFR[n]=CTRANS():CROT() as public programs write it; file head and M17 known",
        ),
        Dialect::Heidenhain => (
            "TNC 640, TNC7; FN 17 needs the code number 555343",
            "an independent computation; no control and no interpreter",
            "TNC 430 technical manual 7-23 (FN 17, code number); TNC 640 34059x-05 page 631 (four decimals); iTNC 530 on spatial angles (A, B, C about fixed axes); ID 507, 1 to 6 known, not read",
        ),
        Dialect::LinuxCnc => (
            "LinuxCNC",
            "virtual machine; LinuxCNC's interpreter",
            "LinuxCNC, G code reference, G10 L2",
        ),
        Dialect::Grbl => (
            "GRBL 1.1: moves only",
            "virtual machine",
            "GRBL 1.1 interface: G10 L2 P1 to P6, no % and no O word; M30 would go back to G54",
        ),
    };
    About {
        controls,
        tried,
        sources,
    }
}
