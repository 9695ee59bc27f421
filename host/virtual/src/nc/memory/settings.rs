//! The parameters of a control, as a scene's `[control]` table holds them.

use serde::Deserialize;
use umi_protocol::pattern::Coding;

/// Whose language the control speaks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ControlFamily {
    /// Fanuc Custom Macro B.
    #[default]
    Fanuc,
    /// Haas: Fanuc's macros, `DPRNT` with literal blanks and fields that expand.
    Haas,
    /// Mitsubishi and Mazak EIA: Fanuc's macros without `BPRNT`.
    Mitsubishi,
    /// LinuxCNC's RS274NGC: O words, named parameters, `G38`.
    #[serde(rename = "linuxcnc")]
    LinuxCnc,
    /// GRBL 1.1: no variables and no flow, `G38`.
    Grbl,
}

impl ControlFamily {
    /// Whether it has Custom Macro B with `DPRNT`.
    #[must_use]
    pub const fn is_macro_b(self) -> bool {
        matches!(self, Self::Fanuc | Self::Haas | Self::Mitsubishi)
    }
}

/// What ends a printed line. EIA has one end of block (0x80) whatever is set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LineEnd {
    /// LF (Fanuc 6001#4 CRO = 0).
    #[default]
    Lf,
    /// LF CR (Fanuc CRO = 1).
    LfCr,
    /// LF CR CR (Fanuc 0100#3 NCR = 0).
    LfCrCr,
    /// CR LF (Brother, Mitsubishi, Fanuc data server).
    CrLf,
    /// CR (Haas).
    Cr,
}

impl LineEnd {
    /// Its characters.
    #[must_use]
    pub const fn characters(self) -> &'static [u8] {
        match self {
            Self::Lf => b"\n",
            Self::LfCr => b"\n\r",
            Self::LfCrCr => b"\n\r\r",
            Self::CrLf => b"\r\n",
            Self::Cr => b"\r",
        }
    }
}

/// What a word without a decimal point means where a length or an angle stands.
/// LinuxCNC and GRBL always calculate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DecimalPoint {
    /// Smallest increments: `X100` is 0.1 mm in IS-B (Fanuc 3401#0 DPI = 0).
    #[default]
    Increments,
    /// Millimetres, inches, degrees: `X100` is 100 mm (DPI = 1).
    Calculator,
}

/// Bounds of what one program may use, so that every run ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "snake_case")]
pub struct ExecutionLimits {
    /// Blocks carried out after a program is selected.
    pub blocks: u64,
    /// Jumps backwards (loops, `GOTO`, repeats of a call) after a program is selected.
    pub loops: u64,
    /// Subprograms (M98, M97) inside each other, macros not counted: 4 on old controls,
    /// 10 on Fanuc 30i; LinuxCNC: subroutines.
    pub call_depth: usize,
    /// Macros (G65, G66) inside each other: 4 with Custom Macro B.
    pub macro_depth: usize,
    /// How often M99 may begin the main program again. A control does so for ever.
    pub main_repeats: u64,
    /// Length of a loaded text, bytes.
    pub text: usize,
    /// Programs in memory.
    pub programs: usize,
    /// Named parameters (LinuxCNC), each level of call counted.
    pub names: usize,
}

impl Default for ExecutionLimits {
    fn default() -> Self {
        Self {
            blocks: 20_000_000,
            loops: 100_000,
            call_depth: 10,
            macro_depth: 4,
            main_repeats: 2,
            text: 4 << 20,
            programs: 1000,
            names: 2000,
        }
    }
}

/// The parameters of a control.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "snake_case")]
pub struct ControlSettings {
    /// Whose language it speaks.
    pub dialect: ControlFamily,
    /// Smallest increment, mm: 0.001 (IS-B) or 0.0001 (IS-C); a tenth of the number in
    /// inches. Programmed words, positions in variables and values of `G10` are rounded
    /// to it. LinuxCNC and GRBL do not round.
    pub increment_mm: f64,
    /// What a word without a decimal point means.
    pub decimal_point: DecimalPoint,
    /// Whether `DPRNT` prints a blank for each leading zero and for a plus sign (Fanuc
    /// 6001#1 PRT = 0, Brother type 1), or neither.
    pub leading_blanks: bool,
    /// What ends a printed line.
    pub line_end: LineEnd,
    /// The code in which characters are sent; `Auto` is ASCII.
    pub coding: Coding,
    /// Whether `POPEN` sends DC2 and `PCLOS` DC4.
    pub dc_codes: bool,
    /// Feed in force when the control is switched on, mm/min: what ran before left it.
    /// Without it a feed motion before the first F is an alarm, as on a control just
    /// switched on.
    pub feed_mm_min: Option<f64>,
    /// What the operator's override makes of a feed, percent: it acts on `G31` and `G38`, too, but
    /// for where `#3004` or LinuxCNC's `M50 P0` hold it off.
    pub feed_override_percent: f64,
    /// How far the radii at both ends of an arc may differ, mm (Fanuc 3410).
    pub arc_tolerance_mm: f64,
    /// The second reference point (`G30`), machine coordinates, mm.
    pub second_reference_mm: Option<[f64; 3]>,
    /// Words of rotary axes that blocks may have, in the order of the machine's axes, as `AC`:
    /// angles in degrees. A scene's are those of its `[[machine.rotary]]`.
    #[serde(skip)]
    pub rotary_words: String,
    /// Whether blocks that begin with `/` are left out.
    pub block_skip: bool,
    /// Whether M1 stops.
    pub optional_stop: bool,
    /// What #3011 says, YYYYMMDD.
    pub date: u32,
    /// What #3012 says, HHMMSS.
    pub time: u32,
    /// Bounds, so that every run ends.
    pub limits: ExecutionLimits,
}

impl Default for ControlSettings {
    fn default() -> Self {
        Self {
            dialect: ControlFamily::default(),
            increment_mm: 0.001,
            decimal_point: DecimalPoint::default(),
            leading_blanks: true,
            line_end: LineEnd::default(),
            coding: Coding::Ascii,
            dc_codes: true,
            feed_mm_min: None,
            feed_override_percent: 100.0,
            arc_tolerance_mm: 0.01,
            second_reference_mm: None,
            rotary_words: String::new(),
            block_skip: false,
            optional_stop: false,
            date: 20_130_101,
            time: 120_000,
            limits: ExecutionLimits::default(),
        }
    }
}

impl ControlSettings {
    /// A control of this dialect with its maker's usual parameters: the end of line of
    /// its manual, DC codes where they are sent (dprnt: Haas ends with CR, Mitsubishi
    /// with CR LF).
    #[must_use]
    pub fn of(dialect: ControlFamily) -> Self {
        Self {
            dialect,
            line_end: match dialect {
                ControlFamily::Haas => LineEnd::Cr,
                ControlFamily::Mitsubishi => LineEnd::CrLf,
                ControlFamily::Fanuc | ControlFamily::LinuxCnc | ControlFamily::Grbl => LineEnd::Lf,
            },
            ..Self::default()
        }
    }

    /// The smallest increment in mm or inches, none if the dialect does not round.
    pub(crate) fn increment(&self, inch: bool) -> Option<f64> {
        self.dialect
            .is_macro_b()
            .then_some(if inch {
                self.increment_mm / 10.0
            } else {
                self.increment_mm
            })
            .filter(|step| step.is_finite() && *step > 0.0)
    }

    /// Rounds a number in mm or inches to the smallest increment.
    pub(crate) fn rounded(&self, value: f64, inch: bool) -> f64 {
        match self.increment(inch) {
            // Dividing by the whole number gives the nearest decimal fraction.
            Some(step) => {
                let per_unit = (1.0 / step).round();
                let steps = (value * per_unit).round();
                if per_unit >= 1.0 && steps.is_finite() {
                    steps / per_unit
                } else {
                    value
                }
            }
            None => value,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scene's table needs no more than what differs; what it does not know it refuses.
    #[test]
    fn from_toml() {
        let settings: ControlSettings = toml::from_str(
            "dialect = \"haas\"\nline_end = \"lf_cr_cr\"\nincrement_mm = 0.0001\n\
             decimal_point = \"calculator\"\ncoding = \"iso_even\"\n[limits]\nblocks = 5\n",
        )
        .expect("a valid table");
        assert_eq!(settings.dialect, ControlFamily::Haas);
        assert_eq!(settings.line_end, LineEnd::LfCrCr);
        assert_eq!(settings.coding, Coding::IsoEven);
        assert_eq!(settings.limits.blocks, 5);
        assert_eq!(
            settings.limits.call_depth,
            ExecutionLimits::default().call_depth
        );
        assert!(toml::from_str::<ControlSettings>("dialekt = \"haas\"").is_err());
    }

    /// Increments: IS-B in mm and inches, none in LinuxCNC.
    #[test]
    fn rounding() {
        let fanuc = ControlSettings::default();
        assert_eq!(fanuc.rounded(21.7889, false), 21.789);
        assert_eq!(fanuc.rounded(-0.00049, false), 0.0);
        assert_eq!(fanuc.rounded(0.12345, true), 0.1235);
        assert_eq!(
            ControlSettings::of(ControlFamily::LinuxCnc).rounded(21.7889, false),
            21.7889
        );
    }
}
