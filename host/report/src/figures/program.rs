//! A correction program's effect, read back from its text as a control reads it. It is a
//! second witness to the figures that the board states.

use crate::vector::Vector;

/// A displacement of the programmed points: `q = O' + c + Rz (p - c) - O`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CorrectionMotion {
    /// O' - O: the new work offset less that in which the setup was probed.
    pub offset_mm: Vector,
    /// The centre of the rotation, work coordinates.
    pub center_mm: [f64; 2],
    /// The rotation about Z as printed.
    pub angle_deg: f64,
}

impl CorrectionMotion {
    /// Reads the `G10 L2` and `G68` blocks of a program. `probed_origin_mm` is
    /// the work offset in which the setup was probed. None if a block or a word
    /// of it is missing, or occurs twice.
    #[must_use]
    pub fn read(program: &str, probed_origin_mm: Vector) -> Option<Self> {
        let blocks: Vec<Vec<(char, f64)>> = program.lines().map(words).collect();
        let origin = only(&blocks, 10.0)?;
        let turn = only(&blocks, 68.0)?;
        (word(origin, 'L')? == 2.0).then_some(())?;
        // About an axis that leans it is another motion.
        word(turn, 'I').is_none().then_some(())?;
        let new_origin = [word(origin, 'X')?, word(origin, 'Y')?, word(origin, 'Z')?];
        Some(Self {
            offset_mm: std::array::from_fn(|i| new_origin[i] - probed_origin_mm[i]),
            center_mm: [word(turn, 'X')?, word(turn, 'Y')?],
            angle_deg: word(turn, 'R')?,
        })
    }

    /// Where a programmed point goes, in the frame of the probing.
    #[must_use]
    pub fn apply(&self, p: Vector) -> Vector {
        let (sin, cos) = self.angle_deg.to_radians().sin_cos();
        let [cx, cy] = self.center_mm;
        let (x, y) = (p[0] - cx, p[1] - cy);
        [
            self.offset_mm[0] + cx + cos * x - sin * y,
            self.offset_mm[1] + cy + sin * x + cos * y,
            self.offset_mm[2] + p[2],
        ]
    }
}

/// The one block with this G word.
fn only(blocks: &[Vec<(char, f64)>], g: f64) -> Option<&[(char, f64)]> {
    let mut found = blocks.iter().filter(|block| block.contains(&('G', g)));
    match (found.next(), found.next()) {
        (Some(block), None) => Some(block),
        _ => None,
    }
}

fn word(block: &[(char, f64)], letter: char) -> Option<f64> {
    block
        .iter()
        .find(|(l, _)| *l == letter)
        .map(|(_, value)| *value)
}

/// The words of a block, comments left out; what is no word is left out too.
fn words(line: &str) -> Vec<(char, f64)> {
    let mut depth = 0u32;
    let mut code = String::new();
    for c in line.chars() {
        match c {
            '(' => depth += 1,
            ')' => depth = depth.saturating_sub(1),
            _ if depth == 0 && !c.is_whitespace() => code.push(c.to_ascii_uppercase()),
            _ => {}
        }
    }
    let mut words = Vec::new();
    let mut rest = code.as_str();
    while let Some(at) = rest.find(|c: char| c.is_ascii_uppercase()) {
        let letter = rest.as_bytes()[at] as char;
        rest = &rest[at + 1..];
        let end = rest
            .find(|c: char| !matches!(c, '0'..='9' | '.' | '-' | '+'))
            .unwrap_or(rest.len());
        if let Ok(value) = rest[..end].parse::<f64>() {
            words.push((letter, value));
        }
        rest = &rest[end..];
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROGRAM: &str = "%\nO9010(UMI CORRECTION G55)\n(TURN 1.0 DEG G68 X9. Y9. R9.)\n\
        G17 G21 G90\nG69\nG10 L2 P2 X100.5 Y-20. Z0.012\nG55\nG68 X10. Y0. R90.\nM99\n%\n";

    /// The words are read as a control reads them; comments are not.
    #[test]
    fn a_program_is_read_back() {
        let motion = CorrectionMotion::read(PROGRAM, [100.0, 0.0, 0.0]).unwrap();
        assert_eq!(motion.offset_mm, [0.5, -20.0, 0.012]);
        let q = motion.apply([11.0, 0.0, 5.0]);
        for (got, due) in q.iter().zip([10.5, -19.0, 5.012]) {
            assert!((got - due).abs() < 1e-12, "{q:?}");
        }
    }

    /// A program that is not whole or not plain says nothing.
    #[test]
    fn a_program_that_is_not_whole_is_not_read() {
        for (from, to) in [
            ("G68 X10. Y0. R90.", "G68 X10. Y0."),
            ("G10 L2 P2 X100.5 ", "G10 L2 P2 "),
            ("G10 L2", "G10 L20"),
            ("G68 X10. Y0.", "G68 X10. Y0. Z0. I0. J0. K1."),
            ("M99", "G68 X0. Y0. R1.\nM99"),
        ] {
            assert_eq!(
                CorrectionMotion::read(&PROGRAM.replace(from, to), [0.0; 3]),
                None
            );
        }
    }
}
