use std::collections::HashMap;

use super::*;
use crate::nc::memory::settings::LineEnd;
use crate::nc::text::cursor::Line;

struct Few(HashMap<u32, f64>);

impl Lookup for Few {
    fn dialect(&self) -> ControlFamily {
        ControlFamily::Fanuc
    }
    fn variable(&self, number: u32) -> Checked<Option<f64>> {
        Ok(self.0.get(&number).copied())
    }
    fn named(&self, _: &str) -> Checked<Option<f64>> {
        Ok(None)
    }
}

fn read(text: &str, dialect: ControlFamily) -> Checked<(Format, Vec<Fault>)> {
    let line = Line::new(text, dialect)?;
    let mut cursor = Cursor::new(&line);
    let kind = if cursor.take_word("DPRNT") {
        Kind::Decimal
    } else {
        cursor.take_word("BPRNT");
        Kind::Binary
    };
    Format::read(&mut cursor, kind, dialect)
}

fn print(settings: &ControlSettings, text: &str, variables: &[(u32, f64)]) -> Vec<u8> {
    let (format, _) = read(text, settings.dialect).expect(text);
    let values = Few(variables.iter().copied().collect());
    format.bytes(&values, settings).expect(text)
}

fn ascii(settings: &ControlSettings, text: &str, variables: &[(u32, f64)]) -> String {
    String::from_utf8(print(settings, text, variables)).expect("ASCII")
}

fn blanks(leading_blanks: bool) -> ControlSettings {
    ControlSettings {
        leading_blanks,
        ..ControlSettings::default()
    }
}

/// Brother's manual, types 1 and 2, byte for byte, in ISO with even parity and CR LF.
#[test]
fn brother_dprnt() {
    let text = "DPRNT[X*#100[44] Y*#101[22] Z*#102[20] *#100[2]]";
    let variables = [(100, -123.456), (101, 123.456), (102, 0.056)];
    let mut settings = ControlSettings {
        line_end: LineEnd::CrLf,
        coding: Coding::IsoEven,
        ..blanks(true)
    };
    assert_eq!(
        print(&settings, text, &variables),
        [
            0xD8, 0xA0, 0x2D, 0xA0, 0xB1, 0xB2, 0x33, 0x2E, 0xB4, 0x35, 0x36, 0x30, 0x59, 0xA0,
            0xA0, 0xB2, 0x33, 0x2E, 0xB4, 0x36, 0x5A, 0xA0, 0xA0, 0xA0, 0x30, 0xA0, 0x2D, 0x2E,
            0xB4, 0x36, 0x8D, 0x0A
        ]
    );
    settings.leading_blanks = false;
    assert_eq!(
        print(&settings, text, &variables),
        [
            0xD8, 0xA0, 0x2D, 0xB1, 0xB2, 0x33, 0x2E, 0xB4, 0x35, 0x36, 0x30, 0x59, 0xA0, 0xB2,
            0x33, 0x2E, 0xB4, 0x36, 0x5A, 0xA0, 0x30, 0xA0, 0x2D, 0x2E, 0xB4, 0x36, 0x8D, 0x0A
        ]
    );
}

/// BPRNT of the manuals of Brother and NCT.
#[test]
fn binary_of_the_manuals() {
    let settings = ControlSettings {
        line_end: LineEnd::CrLf,
        coding: Coding::IsoEven,
        ..ControlSettings::default()
    };
    assert_eq!(
        print(
            &settings,
            "BPRNT[DATA*X*#100[2] Y*#101[2] Z*#102[0]]",
            &[(100, 123.456), (101, -123.456), (102, 0.056)]
        ),
        [
            0x44, 0x41, 0xD4, 0x41, 0xA0, 0xD8, 0xA0, 0x00, 0x00, 0x30, 0x3A, 0x59, 0xA0, 0xFF,
            0xFF, 0xCF, 0xC6, 0x5A, 0xA0, 0x00, 0x00, 0x00, 0x00, 0x8D, 0x0A
        ]
    );
    let settings = ControlSettings {
        coding: Coding::IsoEven,
        ..ControlSettings::default()
    };
    assert_eq!(
        print(
            &settings,
            "BPRNT[C*/X#110[3]Y#120[3]M#112[0]]",
            &[(110, 318.49362), (120, 0.723415), (112, 23.9)]
        ),
        [
            0xC3, 0xA0, 0xAF, 0xD8, 0x00, 0x04, 0xDC, 0x1E, 0x59, 0x00, 0x00, 0x02, 0xD3, 0x4D,
            0x00, 0x00, 0x00, 0x18, 0x0A
        ]
    );
    assert_eq!(
        print(
            &settings,
            "BPRNT[C**X#100[3]Y#101[3]M#10[0]]",
            &[(100, 0.40596), (101, -1638.4), (10, 12.34)]
        ),
        [
            0xC3, 0xA0, 0xA0, 0xD8, 0x00, 0x00, 0x01, 0x96, 0x59, 0xFF, 0xE7, 0x00, 0x00, 0x4D,
            0x00, 0x00, 0x00, 0x0C, 0x0A
        ]
    );
    let (format, _) = read("BPRNT[X#1[3]]", ControlFamily::Fanuc).expect("valid");
    let large = Few(HashMap::from([(1, 3e6)]));
    assert!(format.bytes(&large, &settings).is_err());
}

const FANUC: &str = "DPRNT[X#2[53]Y#5[53]T#30[20]]";
const FANUC_VALUES: [(u32, f64); 3] = [(2, 128.47398), (5, -91.2), (30, 123.456)];

/// The example of Fanuc's manual with both settings of PRT and of CRO.
#[test]
fn fanuc_dprnt() {
    assert_eq!(
        ascii(&blanks(true), FANUC, &FANUC_VALUES),
        "X   128.474Y-   91.200T 23\n"
    );
    assert_eq!(
        ascii(&blanks(false), FANUC, &FANUC_VALUES),
        "X128.474Y-91.200T23\n"
    );
    let cro = ControlSettings {
        line_end: LineEnd::LfCr,
        ..blanks(true)
    };
    assert!(ascii(&cro, FANUC, &FANUC_VALUES).ends_with("T 23\n\r"));
    let iso = ControlSettings {
        coding: Coding::IsoEven,
        ..blanks(true)
    };
    assert_eq!(
        print(&iso, FANUC, &FANUC_VALUES),
        [
            0xD8, 0xA0, 0xA0, 0xA0, 0xB1, 0xB2, 0xB8, 0x2E, 0xB4, 0xB7, 0xB4, 0x59, 0x2D, 0xA0,
            0xA0, 0xA0, 0x39, 0xB1, 0x2E, 0xB2, 0x30, 0x30, 0xD4, 0xA0, 0xB2, 0x33, 0x0A
        ]
    );
    let eia = ControlSettings {
        coding: Coding::Eia,
        line_end: LineEnd::LfCrCr,
        ..blanks(true)
    };
    assert_eq!(
        print(&eia, "DPRNT[X#2[53]Y#5[53]]", &FANUC_VALUES),
        [
            0x37, 0x10, 0x10, 0x10, 0x01, 0x02, 0x08, 0x6B, 0x04, 0x07, 0x04, 0x38, 0x40, 0x10,
            0x10, 0x10, 0x19, 0x01, 0x6B, 0x02, 0x20, 0x20, 0x80
        ]
    );
}

/// Negative zero, null and overflow in columns.
#[test]
fn awkward_values() {
    let text = "DPRNT[P*1*X#1[33]*Y#2[33]*Z#3[33]]";
    let settings = blanks(true);
    assert_eq!(
        ascii(&settings, text, &[(1, 12.3456), (2, -0.0004), (3, -100.0)]),
        "P 1 X  12.346 Y-  0.000 Z-100.000\n"
    );
    assert_eq!(
        ascii(&settings, text, &[(2, 0.0), (3, -0.5)]),
        "P 1 X   0.000 Y   0.000 Z-  0.500\n"
    );
    assert_eq!(
        ascii(
            &settings,
            text,
            &[(1, 1234.5678), (2, -1234.5), (3, 99_999.999_6)]
        ),
        "P 1 X 234.568 Y-234.500 Z   0.000\n"
    );
    assert_eq!(
        ascii(&settings, "DPRNT[#1[45]]", &[(1, 1e300)]).len(),
        1 + 4 + 1 + 5 + 1
    );
}

/// Haas expands a field and sends literal blanks; a lone pair of brackets is a line end.
#[test]
fn haas_dprnt() {
    let settings = ControlSettings::of(ControlFamily::Haas);
    assert_eq!(
        ascii(&settings, "DPRNT[***MEASURED*INSIDE*DIAMETER***]", &[]),
        "   MEASURED INSIDE DIAMETER   \r"
    );
    assert_eq!(ascii(&settings, "DPRNT[]", &[]), "\r");
    assert_eq!(
        ascii(&settings, "DPRNT[X#1[25]]", &[(1, -123.456789)]),
        "X-123.45679\r"
    );
    assert_eq!(
        ascii(&settings, "DPRNT[A #1[03]]", &[(1, 1.5436)]),
        "A 1.544\r"
    );
    assert_eq!(
        ascii(&settings, "DPRNT[Z#1[33]]", &[(1, -1.5)]),
        "Z  -1.500\r"
    );
}

/// The lines of the thesis: brackets not closed, blanks before the places, commas.
#[test]
fn lines_of_the_thesis() {
    let settings = blanks(false);
    let hit = [(1, 21.789), (2, 249.049)];
    assert_eq!(
        ascii(&settings, "DPRNT[1,#1 [44], #2 [44]", &hit),
        "1,21.7890,249.0490\n"
    );
    let (_, warnings) = read("DPRNT[1,#1 [44], #2 [44]", ControlFamily::Fanuc).expect("taken");
    assert_eq!(warnings.len(), 1);
    assert_eq!(ascii(&settings, "DPRNT[***]", &[]), "   \n");
}

/// What a control refuses.
#[test]
fn refused() {
    for text in [
        "DPRNT[#1]",
        "DPRNT[#1[00]]",
        "DPRNT[#1[333]]",
        "DPRNT[#1[91]]",
        "DPRNT[A$B]",
        "DPRNT X",
        "BPRNT[#1[53]]",
    ] {
        assert!(read(text, ControlFamily::Fanuc).is_err(), "{text}");
    }
    assert!(read("BPRNT[X#1[3]]", ControlFamily::Haas).is_err());
}
