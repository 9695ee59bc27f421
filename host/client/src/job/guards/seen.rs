//! From which size on an error is seen, and which of two is seen last.

use nalgebra::Vector3;

/// From when on a job sees an error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SeenFrom {
    /// Whatever its size.
    Always,
    /// From this size on, µm.
    Size(f64),
    /// Not before so many seconds have passed.
    After(u32),
    /// Never, up to a metre.
    Never,
}

/// The one that is seen last.
pub(super) fn worst(all: impl Iterator<Item = SeenFrom>) -> SeenFrom {
    all.reduce(|a, b| if is_later(a, b) { a } else { b })
        .unwrap_or(SeenFrom::Never)
}

pub(super) fn worse(
    a: (Vector3<f64>, SeenFrom),
    b: (Vector3<f64>, SeenFrom),
) -> (Vector3<f64>, SeenFrom) {
    if is_later(b.1, a.1) { b } else { a }
}

fn is_later(a: SeenFrom, than: SeenFrom) -> bool {
    a != than && least(a, than) == than
}

pub(super) fn least(a: SeenFrom, b: SeenFrom) -> SeenFrom {
    match (a, b) {
        (SeenFrom::Always, _) | (_, SeenFrom::Always) => SeenFrom::Always,
        (SeenFrom::Size(a), SeenFrom::Size(b)) => SeenFrom::Size(a.min(b)),
        (SeenFrom::Size(a), SeenFrom::Never) | (SeenFrom::Never, SeenFrom::Size(a)) => {
            SeenFrom::Size(a)
        }
        (SeenFrom::After(_), other) | (other, SeenFrom::After(_)) => other,
        (SeenFrom::Never, SeenFrom::Never) => SeenFrom::Never,
    }
}
