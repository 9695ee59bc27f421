//! Directions that nothing sees, in words.

use nalgebra::{DMatrix, DVector};

/// Short names of the directions: of those that span them all, the ones with the fewest
/// components. `names`: of the components; `worth`: what a unit of each is worth.
pub(super) fn name_directions(
    directions: &[DVector<f64>],
    names: &[&str],
    worth: &[f64],
) -> Vec<String> {
    reduced_rows(directions, worth)
        .row_iter()
        .map(|row| {
            let largest = row.amax();
            let parts: Vec<(f64, &str)> = row
                .iter()
                .zip(names)
                .filter(|(value, _)| value.abs() > 0.02 * largest)
                .map(|(value, name)| (*value, *name))
                .collect();
            match parts.as_slice() {
                [(_, name)] => (*name).to_owned(),
                parts => parts
                    .iter()
                    .map(|(value, name)| format!("{value:+.2} {name}"))
                    .collect::<Vec<_>>()
                    .join(" "),
            }
        })
        .collect()
}

/// What nothing shows of a mount, of so many motions that were sought, in words.
pub(super) fn open_in_words(unobservable: &[String], sought: usize) -> String {
    if unobservable.len() == sought {
        return "Nothing that was seen shows where the sensor sits: every motion of it that is sought is free".into();
    }
    let mut mixed = false;
    let parts: Vec<String> = (unobservable.iter())
        .map(|name| {
            let axis = |kind| name.strip_prefix(kind).filter(|axis| axis.len() == 1);
            if let Some(axis) = axis("t") {
                return format!("the shift along {}", axis.to_uppercase());
            }
            if let Some(axis) = axis("w") {
                return format!("the turn about {}", axis.to_uppercase());
            }
            mixed = true;
            format!("the motion {name}")
        })
        .collect();
    let legend = if mixed {
        " (t: shift along its axes in mm, w: turn about them in rad)"
    } else {
        ""
    };
    format!(
        "Nothing that was seen shows {} of the flange{legend}",
        parts.join(", ")
    )
}

/// Gauss-Jordan with the largest pivot: a basis of the same space with many zeros.
fn reduced_rows(directions: &[DVector<f64>], worth: &[f64]) -> DMatrix<f64> {
    let columns = worth.len();
    let mut rows = DMatrix::from_fn(directions.len(), columns, |row, column| {
        directions[row][column] / worth[column]
    });
    for pivot_row in 0..rows.nrows() {
        let Some(pivot) = (0..columns).max_by(|&a, &b| {
            rows[(pivot_row, a)]
                .abs()
                .total_cmp(&rows[(pivot_row, b)].abs())
        }) else {
            break;
        };
        let value = rows[(pivot_row, pivot)];
        if value == 0.0 {
            continue;
        }
        for column in 0..columns {
            rows[(pivot_row, column)] /= value;
        }
        for other in (0..rows.nrows()).filter(|&row| row != pivot_row) {
            let factor = rows[(other, pivot)];
            for column in 0..columns {
                rows[(other, column)] -= factor * rows[(pivot_row, column)];
            }
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mixed_basis_gets_its_plain_names() {
        let directions = [
            DVector::from_vec(vec![0.8, 0.6, 0.0]),
            DVector::from_vec(vec![-0.6, 0.8, 0.0]),
        ];
        let mut names = name_directions(&directions, &["tx", "ty", "tz"], &[1.0; 3]);
        names.sort();
        assert_eq!(names, ["tx", "ty"]);
        let slanted = [DVector::from_vec(vec![0.6, 0.0, 0.6])];
        let names = name_directions(&slanted, &["tx", "ty", "tz"], &[1.0; 3]);
        assert_eq!(names, ["+1.00 tx +1.00 tz"]);
    }
}
