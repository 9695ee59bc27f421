//! Programs for Siemens and Heidenhain, read as their manuals say it: points are turned axis
//! by axis with sine and cosine. No control has run them.

use crate::dialects::V;

/// The numbers behind the marks, which must come in this order.
fn numbers(text: &str, marks: &[&str]) -> Vec<f64> {
    let mut rest = text;
    marks
        .iter()
        .map(|mark| {
            let at = rest
                .find(mark)
                .unwrap_or_else(|| panic!("no {mark}: {text}"));
            rest = &rest[at + mark.len()..];
            let end = rest
                .find(|c: char| !matches!(c, '0'..='9' | '.' | '-'))
                .unwrap_or(rest.len());
            assert!(rest[..end].contains('.'), "no decimal point: {text}");
            rest[..end].parse().unwrap()
        })
        .collect()
}

/// A turn to the right in a plane: the first coordinate goes towards the second.
fn turn(first: f64, second: f64, degrees: f64) -> (f64, f64) {
    let (sin, cos) = degrees.to_radians().sin_cos();
    (first * cos - second * sin, first * sin + second * cos)
}

/// RPY (MD10600 = 1): the frame turns about Z, then about its own Y, then about its own X. A
/// point that is fixed in it makes the turns in the other order, innermost first.
pub fn siemens(text: &str, points: &[V]) -> Vec<V> {
    let frame = text.lines().find(|l| l.starts_with("$P_UIFR[")).unwrap();
    let n = numbers(
        frame,
        &["CTRANS(X,", ",Y,", ",Z,", ":CROT(X,", ",Y,", ",Z,"],
    );
    assert!(n[4].abs() < 90.0 && n[3].abs() <= 180.0 && n[5].abs() <= 180.0);
    let mut axes = [V::x(), V::y(), V::z()];
    // Each turn makes new axes out of the two across it.
    for (about, degrees) in [(2, n[5]), (1, n[4]), (0, n[3])] {
        let (i, j) = ((about + 1) % 3, (about + 2) % 3);
        let (sin, cos) = degrees.to_radians().sin_cos();
        let (was_i, was_j) = (axes[i], axes[j]);
        axes[i] = was_i * cos + was_j * sin;
        axes[j] = was_j * cos - was_i * sin;
    }
    let shift = V::new(n[0], n[1], n[2]);
    points
        .iter()
        .map(|p| shift + axes[0] * p.x + axes[1] * p.y + axes[2] * p.z)
        .collect()
}

/// Spatial angles: about the machine's X by SPA, then its Y by SPB, then its Z by SPC.
pub fn heidenhain(text: &str, points: &[V]) -> Vec<V> {
    let marks = [1, 2, 3, 4, 5, 6].map(|index| format!("IDX{index} = "));
    let n = numbers(text, &marks.each_ref().map(String::as_str));
    let mut rows = text.lines().filter(|l| l.starts_with("FN 17"));
    let row = rows.next().unwrap().split("NR").nth(1).unwrap();
    let row = row.split(' ').next().unwrap();
    assert!(rows.all(|l| l.contains(&format!(" NR{row} "))), "{text}");
    assert!(text.contains(&format!("Q339={row} ;")), "{text}");
    points
        .iter()
        .map(|p| {
            let (mut x, mut y, mut z) = (p.x, p.y, p.z);
            (y, z) = turn(y, z, n[3]);
            (z, x) = turn(z, x, n[4]);
            (x, y) = turn(x, y, n[5]);
            V::new(x + n[0], y + n[1], z + n[2])
        })
        .collect()
}
