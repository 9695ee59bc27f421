//! Vectors as arrays.

/// A vector in mm, or one per axis.
pub type Vector = [f64; 3];

/// Length of a vector.
#[must_use]
pub fn length(v: Vector) -> f64 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt()
}

/// `a - b`.
#[must_use]
pub fn minus(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] - b[i])
}

/// `R p + t`.
#[must_use]
pub fn transform(rotation: &[Vector; 3], translation: Vector, p: Vector) -> Vector {
    std::array::from_fn(|i| {
        rotation[i].iter().zip(p).map(|(r, c)| r * c).sum::<f64>() + translation[i]
    })
}
