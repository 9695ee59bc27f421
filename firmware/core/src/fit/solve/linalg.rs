//! Small dense linear algebra on arrays, the same bits on every target.
//!
//! Only `+ - * /` and `libm::sqrt`, in a fixed order. Least squares go through
//! a QR of blocks of rows (Householder), not through `JᵀJ`: its error grows with
//! the condition of the points, not with the square of it.

// Every index here runs over `0..K` of arrays of length K, so none can be out
// of bounds, and iterator forms of triangular loops would hide the formulas.
#![allow(clippy::indexing_slicing, clippy::needless_range_loop)]

use nalgebra::Vector3;

/// A square matrix, rows first.
pub(crate) type Square<const K: usize> = [[f64; K]; K];

/// Length of a vector, without nalgebra's `norm` (which may be a std function).
pub(crate) fn norm(v: &Vector3<f64>) -> f64 {
    libm::sqrt(v.dot(v))
}

/// The unit vector along `v`; None if `v` has no direction.
pub(crate) fn unit(v: &Vector3<f64>) -> Option<Vector3<f64>> {
    let length = norm(v);
    (length > 0.0 && length.is_finite()).then(|| v / length)
}

/// The one of `v` and `-v` whose largest component is positive: one name for a
/// normal or an axis that has no sense of its own.
pub(crate) fn canonical_sign(v: &Vector3<f64>) -> Vector3<f64> {
    let (x, y, z) = (v.x.abs(), v.y.abs(), v.z.abs());
    let largest = if x >= y && x >= z {
        v.x
    } else if y >= z {
        v.y
    } else {
        v.z
    };
    if largest < 0.0 { -v } else { *v }
}

/// Two unit vectors that complete the unit vector `axis` to a right-handed
/// frame (e1, e2, axis).
pub(crate) fn perpendicular_frame(axis: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let (x, y, z) = (axis.x.abs(), axis.y.abs(), axis.z.abs());
    // The coordinate axis farthest from `axis` gives the best defined product.
    let helper = if x <= y && x <= z {
        Vector3::new(1.0, 0.0, 0.0)
    } else if y <= z {
        Vector3::new(0.0, 1.0, 0.0)
    } else {
        Vector3::new(0.0, 0.0, 1.0)
    };
    let e1 = axis.cross(&helper);
    let e1 = e1 / norm(&e1);
    (e1, axis.cross(&e1))
}

/// `a bᵀ` scaled and summed: `Σ weight · column columnᵀ` for a symmetric 3x3.
pub(crate) fn outer_sum<const N: usize>(terms: [(f64, Vector3<f64>); N]) -> Square<3> {
    let mut sum = [[0.0; 3]; 3];
    for (weight, v) in terms {
        let v = [v.x, v.y, v.z];
        for i in 0..3 {
            for j in 0..3 {
                sum[i][j] += weight * v[i] * v[j];
            }
        }
    }
    sum
}

/// The matrix plus `row rowᵀ`: the growing left side of normal equations.
pub(crate) fn added<const K: usize>(matrix: &Square<K>, row: &[f64; K]) -> Square<K> {
    let mut sum = *matrix;
    for i in 0..K {
        for j in 0..K {
            sum[i][j] += row[i] * row[j];
        }
    }
    sum
}

/// The matrix with a small part of its trace added to the diagonal.
pub(crate) fn ridged<const K: usize>(matrix: &Square<K>, part: f64) -> Square<K> {
    let mut sum = *matrix;
    let trace: f64 = (0..K).fold(0.0, |trace, i| trace + matrix[i][i]);
    for i in 0..K {
        sum[i][i] += part * trace;
    }
    sum
}

/// The diagonal.
pub(crate) fn diagonal<const K: usize>(matrix: &Square<K>) -> [f64; K] {
    let mut diagonal = [0.0; K];
    for i in 0..K {
        diagonal[i] = matrix[i][i];
    }
    diagonal
}

/// `A C Aᵀ` for a Jacobian A (M rows, K columns) and a symmetric C: the
/// propagation of a covariance.
pub(crate) fn propagate<const M: usize, const K: usize>(
    jacobian: &[[f64; K]; M],
    covariance: &Square<K>,
) -> Square<M> {
    let mut half = [[0.0; K]; M];
    for i in 0..M {
        for j in 0..K {
            for k in 0..K {
                half[i][j] += jacobian[i][k] * covariance[k][j];
            }
        }
    }
    let mut result = [[0.0; M]; M];
    for i in 0..M {
        for j in 0..=i {
            let mut sum = 0.0;
            for k in 0..K {
                sum += half[i][k] * jacobian[j][k];
            }
            result[i][j] = sum;
            result[j][i] = sum;
        }
    }
    result
}

/// The matrix times a factor.
pub(crate) fn scaled<const K: usize>(matrix: &Square<K>, factor: f64) -> Square<K> {
    matrix.map(|row| row.map(|x| x * factor))
}

/// True if every element is a number.
pub(crate) fn all_finite<const K: usize>(matrix: &Square<K>) -> bool {
    matrix.iter().flatten().all(|x| x.is_finite())
}

/// `xᵀ A x`.
pub(crate) fn quadratic_form<const K: usize>(matrix: &Square<K>, x: &[f64; K]) -> f64 {
    let mut sum = 0.0;
    for i in 0..K {
        let mut row = 0.0;
        for j in 0..K {
            row += matrix[i][j] * x[j];
        }
        sum += row * x[i];
    }
    sum
}

/// Largest eigenvalue of a symmetric 3x3 matrix that is not negative definite,
/// that is the largest variance of a covariance.
pub(crate) fn largest_variance(covariance: &Square<3>) -> f64 {
    let svd = Svd3::new(covariance);
    svd.values[0]
}

/// The sum of the variances of a covariance: no direction has a larger one.
pub(crate) fn trace(covariance: &Square<3>) -> f64 {
    let [[xx, ..], [_, yy, _], [.., zz]] = covariance;
    xx + yy + zz
}

/// The upper left 3x3 block of a larger matrix.
pub(crate) fn block3<const K: usize>(matrix: &Square<K>) -> Square<3> {
    let mut block = [[0.0; 3]; 3];
    for i in 0..3.min(K) {
        for j in 0..3.min(K) {
            block[i][j] = matrix[i][j];
        }
    }
    block
}

/// The lower triangle L of a positive definite matrix `A = L Lᵀ`.
pub(crate) struct Cholesky<const K: usize> {
    lower: Square<K>,
}

impl<const K: usize> Cholesky<K> {
    /// None if the matrix is not positive definite beyond rounding: this is
    /// the test that a stationary point is a minimum.
    pub(crate) fn new(a: &Square<K>) -> Option<Self> {
        let mut lower = [[0.0; K]; K];
        for i in 0..K {
            for j in 0..=i {
                let mut sum = a[i][j];
                for k in 0..j {
                    sum -= lower[i][k] * lower[j][k];
                }
                if i == j {
                    // A pivot that cancelled to rounding level is not positive.
                    let positive = sum > 8.0 * f64::EPSILON * a[i][i].abs();
                    if !positive || !sum.is_finite() {
                        return None;
                    }
                    lower[i][i] = libm::sqrt(sum);
                } else {
                    lower[i][j] = sum / lower[j][j];
                }
            }
        }
        Some(Self { lower })
    }

    /// The solution x of `A x = b`.
    pub(crate) fn solve(&self, b: &[f64; K]) -> [f64; K] {
        let mut x = *b;
        for i in 0..K {
            for k in 0..i {
                x[i] -= self.lower[i][k] * x[k];
            }
            x[i] /= self.lower[i][i];
        }
        for i in (0..K).rev() {
            for k in i + 1..K {
                x[i] -= self.lower[k][i] * x[k];
            }
            x[i] /= self.lower[i][i];
        }
        x
    }
}

/// Rows that are gathered before they go into the triangle together: each block costs one root
/// and two divisions a column, where a rotation for each row would cost that for every element.
const BLOCK: usize = 8;

/// Squares below this have lost digits, and their inverse would be infinite: coordinates at unit size whose
/// squares are that small are zero.
const SQUARES_THAT_VANISH: f64 = 1e-290;

/// The triangle R of a tall matrix `J = Q R`, built from blocks of rows with Householder
/// reflections (Golub and Van Loan, Matrix Computations, sections 5.2.2 and 5.2.3), and `Qᵀb`
/// beside it.
pub(crate) struct Qr<const K: usize> {
    r: Square<K>,
    rhs: [f64; K],
    /// Rows that are not in the triangle yet, each with its right side.
    rows: [([f64; K], f64); BLOCK],
    gathered: usize,
}

impl<const K: usize> Qr<K> {
    /// No rows yet.
    pub(crate) fn new() -> Self {
        Self {
            r: [[0.0; K]; K],
            rhs: [0.0; K],
            rows: [([0.0; K], 0.0); BLOCK],
            gathered: 0,
        }
    }

    /// Adds the equation `row · x = b`.
    pub(crate) fn add(&mut self, row: [f64; K], b: f64) {
        if let Some(free) = self.rows.get_mut(self.gathered) {
            *free = (row, b);
            self.gathered += 1;
        }
        if self.gathered == BLOCK {
            self.reduce();
        }
    }

    /// The triangle of all rows: the one of `JᵀJ = RᵀR` with nothing negative on its diagonal.
    pub(crate) fn triangle(mut self) -> Triangle<K> {
        self.reduce();
        for k in 0..K {
            if self.r[k][k] < 0.0 {
                self.r[k] = self.r[k].map(|x| -x);
                self.rhs[k] = -self.rhs[k];
            }
        }
        Triangle {
            r: self.r,
            rhs: self.rhs,
        }
    }

    /// Reflects what was gathered into the triangle, column by column. A reflector has one
    /// element in the triangle, because the rows below it there are zero in that column.
    fn reduce(&mut self) {
        let Self {
            r, rhs, gathered, ..
        } = self;
        let rows = self.rows.get_mut(..*gathered).unwrap_or_default();
        for k in 0..K {
            let below = rows.iter().fold(0.0, |sum, (row, _)| sum + row[k] * row[k]);
            if below < SQUARES_THAT_VANISH {
                // Nothing to reflect, or nothing that could be told from zero.
                continue;
            }
            let above = r[k][k];
            let length = libm::sqrt(above * above + below);
            // Of the two possible signs the one that does not cancel.
            let pivot = if above > 0.0 { -length } else { length };
            // The reflector is (head, rows[k]); twice over its square: 1 / (head · -pivot).
            let head = above - pivot;
            let factor = -1.0 / (head * pivot);
            r[k][k] = pivot;
            for j in k + 1..K {
                let dot = rows
                    .iter()
                    .fold(head * r[k][j], |sum, (row, _)| sum + row[k] * row[j]);
                let part = dot * factor;
                r[k][j] -= part * head;
                for (row, _) in rows.iter_mut() {
                    row[j] -= part * row[k];
                }
            }
            let dot = rows
                .iter()
                .fold(head * rhs[k], |sum, (row, b)| sum + row[k] * b);
            let part = dot * factor;
            rhs[k] -= part * head;
            for (row, b) in rows.iter_mut() {
                *b -= part * row[k];
            }
        }
        *gathered = 0;
    }
}

/// The triangle R of `J = Q R`, and `Qᵀb`.
pub(crate) struct Triangle<const K: usize> {
    r: Square<K>,
    rhs: [f64; K],
}

impl<const K: usize> Triangle<K> {
    /// The least squares solution; None if a column depends on the others.
    pub(crate) fn solve(&self) -> Option<[f64; K]> {
        let mut x = self.rhs;
        for i in (0..K).rev() {
            for j in i + 1..K {
                x[i] -= self.r[i][j] * x[j];
            }
            x[i] /= self.r[i][i];
        }
        x.iter().all(|v| v.is_finite()).then_some(x)
    }

    /// `inv(JᵀJ) = R⁻¹ R⁻ᵀ`; None if it does not exist.
    pub(crate) fn inverse_gram(&self) -> Option<Square<K>> {
        // R⁻¹, column by column by back substitution.
        let mut inverse = [[0.0; K]; K];
        for column in 0..K {
            for i in (0..=column).rev() {
                let mut sum = if i == column { 1.0 } else { 0.0 };
                for j in i + 1..=column {
                    sum -= self.r[i][j] * inverse[j][column];
                }
                inverse[i][column] = sum / self.r[i][i];
            }
        }
        let mut gram = [[0.0; K]; K];
        for i in 0..K {
            for j in 0..=i {
                let mut sum = 0.0;
                for k in i..K {
                    sum += inverse[i][k] * inverse[j][k];
                }
                gram[i][j] = sum;
                gram[j][i] = sum;
            }
        }
        all_finite(&gram).then_some(gram)
    }
}

// Indices run over 0..M of arrays of length K, with M less than K.
impl<const K: usize> Triangle<K> {
    /// The equations of the first M columns, whose right side is the last column; and the square of what they
    /// leave of that.
    pub(crate) fn leading<const M: usize>(&self) -> (Triangle<M>, f64) {
        let mut leading = Triangle {
            r: [[0.0; M]; M],
            rhs: [0.0; M],
        };
        let mut left = 0.0;
        for i in 0..K {
            let right = self.r[i][K - 1];
            if i < M {
                leading.rhs[i] = right;
                for j in i..M {
                    leading.r[i][j] = self.r[i][j];
                }
            } else {
                left += right * right;
            }
        }
        (leading, left)
    }
}

impl Triangle<3> {
    /// Whether the middle singular value is surely above `floor` and above `limit` times the
    /// largest. False where only the singular values themselves can tell.
    ///
    /// The squares of all minors of order two sum up to `σ₁²σ₂² + σ₁²σ₃² + σ₂²σ₃² <= 3 σ₁²σ₂²`,
    /// and `σ₁²` is at most the sum F of the squares of all elements. 4 instead of 3 leaves more
    /// than rounding.
    pub(crate) fn surely_spans_plane(&self, limit: f64, floor: f64) -> bool {
        let [[a, b, c], [_, d, e], [_, _, f]] = self.r;
        let minors = [a * d, a * e, b * e - c * d, a * f, b * f, d * f];
        let minors = minors.iter().fold(0.0, |sum, minor| sum + minor * minor);
        let squares = self.squares();
        minors > 4.0 * limit * limit * squares * squares && minors > 4.0 * floor * floor * squares
    }

    /// The same of the smallest singular value: `σ₃ = |det| / (σ₁σ₂)`, and `σ₁σ₂ <= F / 2`.
    pub(crate) fn surely_spans_space(&self, limit: f64, floor: f64) -> bool {
        let [[a, ..], [_, d, _], [_, _, f]] = self.r;
        let determinant = a * d * f;
        let squares = self.squares();
        let room = 2.0 * determinant * determinant;
        room > limit * limit * squares * squares * squares
            && room > floor * floor * squares * squares
    }

    /// Its rows: three vectors with the same sum of squares and products as all rows have.
    pub(crate) fn rows(&self) -> [Vector3<f64>; 3] {
        self.r.map(Vector3::from)
    }

    /// The sum of the squares of all elements.
    fn squares(&self) -> f64 {
        self.r.iter().flatten().fold(0.0, |sum, x| sum + x * x)
    }

    /// Singular values and right singular vectors of the matrix whose rows
    /// were added.
    pub(crate) fn svd(&self) -> Svd3 {
        Svd3::new(&self.r)
    }
}

/// Singular value decomposition `A = U S Vᵀ` of a 3x3 matrix.
pub(crate) struct Svd3 {
    /// Left singular vectors; only the first two, since the third is their
    /// product up to sign and may be undefined.
    pub(crate) left: [Vector3<f64>; 2],
    /// Singular values, largest first.
    pub(crate) values: [f64; 3],
    /// Right singular vectors, a right-handed orthonormal frame.
    pub(crate) right: [Vector3<f64>; 3],
}

impl Svd3 {
    /// One-sided Jacobi (Hestenes 1958): columns are rotated against each
    /// other until they are orthogonal. Small singular values keep their
    /// digits, which eigenvalues of `AᵀA` would lose.
    pub(crate) fn new(a: &Square<3>) -> Self {
        let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = *a;
        let mut first = Column::new(xx, yx, zx, Vector3::new(1.0, 0.0, 0.0));
        let mut second = Column::new(xy, yy, zy, Vector3::new(0.0, 1.0, 0.0));
        let mut third = Column::new(xz, yz, zz, Vector3::new(0.0, 0.0, 1.0));
        // Convergence is quadratic: 3x3 matrices need four to six sweeps.
        for _sweep in 0..30 {
            let turned = [
                first.turn_from(&mut second),
                first.turn_from(&mut third),
                second.turn_from(&mut third),
            ];
            if turned == [false; 3] {
                break;
            }
        }
        first.put_before(&mut second);
        second.put_before(&mut third);
        first.put_before(&mut second);
        Self {
            left: [first.left(), second.left()],
            values: [norm(&first.image), norm(&second.image), norm(&third.image)],
            // Turns left the frame orthonormal only up to a few roundings; it is
            // rebuilt so that it is right-handed and orthonormal to the last digit.
            right: orthonormal(&first.source, &second.source),
        }
    }
}

/// A direction and its image under the matrix: a column of V and of `A V`.
struct Column {
    source: Vector3<f64>,
    image: Vector3<f64>,
}

impl Column {
    fn new(x: f64, y: f64, z: f64, source: Vector3<f64>) -> Self {
        Self {
            source,
            image: Vector3::new(x, y, z),
        }
    }

    /// Turns two columns in their plane until the images are orthogonal; false if
    /// they are already.
    fn turn_from(&mut self, other: &mut Self) -> bool {
        let alpha = self.image.dot(&self.image);
        let beta = other.image.dot(&other.image);
        let gamma = self.image.dot(&other.image);
        // Against the squares: a root for each would cost more than the turn.
        if gamma * gamma <= 0.25 * f64::EPSILON * f64::EPSILON * alpha * beta {
            return false;
        }
        let zeta = (beta - alpha) / (2.0 * gamma);
        let sign = if zeta >= 0.0 { 1.0 } else { -1.0 };
        let t = sign / (zeta.abs() + libm::sqrt(1.0 + zeta * zeta));
        let c = 1.0 / libm::sqrt(1.0 + t * t);
        let s = c * t;
        let turned = |x: &mut Vector3<f64>, y: &mut Vector3<f64>| {
            (*x, *y) = (*x * c - *y * s, *x * s + *y * c);
        };
        turned(&mut self.source, &mut other.source);
        turned(&mut self.image, &mut other.image);
        true
    }

    /// Exchanges the two if the other has the longer image.
    fn put_before(&mut self, other: &mut Self) {
        if norm(&self.image) < norm(&other.image) {
            core::mem::swap(self, other);
        }
    }

    /// The unit vector along the image; any one if that is zero.
    fn left(&self) -> Vector3<f64> {
        unit(&self.image).unwrap_or(self.source)
    }
}

/// A right-handed orthonormal frame whose first vector is along `a` and whose
/// second lies in the plane of `a` and `b` (Gram-Schmidt).
pub(crate) fn orthonormal(a: &Vector3<f64>, b: &Vector3<f64>) -> [Vector3<f64>; 3] {
    let first = unit(a).unwrap_or_else(|| Vector3::new(1.0, 0.0, 0.0));
    let second = unit(&(b - first * first.dot(b))).unwrap_or_else(|| perpendicular_frame(&first).0);
    // A second projection removes what the first left when a and b are close.
    let second = unit(&(second - first * first.dot(&second))).unwrap_or(second);
    [first, second, first.cross(&second)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::solve::cloud::count;

    #[test]
    fn singular_values_of_a_nearly_singular_matrix_keep_their_digits() {
        // A = D Q with Q a rotation: singular values are the diagonal of D.
        let (c, s) = (0.6, 0.8);
        let d = [3.0, 1e-6, 1e-12];
        let a = [
            [d[0] * c, d[0] * s, 0.0],
            [-d[1] * s, d[1] * c, 0.0],
            [0.0, 0.0, d[2]],
        ];
        let svd = Svd3::new(&a);
        for (value, wanted) in svd.values.iter().zip(d) {
            assert!((value - wanted).abs() <= 1e-15 * wanted, "{value} {wanted}");
        }
    }

    /// What is told without the singular values is what they say, near the limit too.
    #[test]
    fn sure_spans_agree_with_the_singular_values() {
        let (mut sure, mut unsure) = (0, 0);
        for exponent in 0..40 {
            let small = 10_f64.powi(-exponent) * 1.7;
            for (middle, smallest) in [(1.0, small), (small, small * 0.1), (0.3, small * 0.5)] {
                let mut qr = Qr::<3>::new();
                qr.add([0.6, 0.8, 0.1], 0.0);
                qr.add([-0.8 * middle, 0.6 * middle, 0.2 * middle], 0.0);
                qr.add([0.1 * smallest, 0.2 * smallest, smallest], 0.0);
                let triangle = qr.triangle();
                for (limit, floor) in [(1e-6, 1e-13), (1e-12, 1e-9)] {
                    let [first, second, third] = triangle.svd().values;
                    let above = |value: f64| value > limit * first && value > floor;
                    if triangle.surely_spans_plane(limit, floor) {
                        assert!(above(second), "{middle} {smallest}");
                        sure += 1;
                    } else {
                        unsure += 1;
                    }
                    if triangle.surely_spans_space(limit, floor) {
                        assert!(above(third), "{middle} {smallest}");
                    }
                }
            }
        }
        assert!(sure > 50 && unsure > 50, "{sure} {unsure}");
    }

    #[test]
    fn svd_of_a_singular_matrix_has_a_right_handed_frame() {
        let svd = Svd3::new(&[[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [1.0, 0.0, 1.0]]);
        let [a, b, c] = svd.right;
        assert!((a.cross(&b) - c).amax() < 1e-15);
        assert!(svd.values[2] < 1e-15 * svd.values[0]);
    }

    #[test]
    fn qr_solves_and_inverts_like_the_exact_answer() {
        let mut qr = Qr::<2>::new();
        // Straight line through (0,1), (1,3), (2,5), (3,7): 1 + 2 t.
        for t in 0..4 {
            let t = f64::from(t);
            qr.add([1.0, t], 1.0 + 2.0 * t);
        }
        let triangle = qr.triangle();
        let x = triangle.solve().unwrap();
        assert!((x[0] - 1.0).abs() < 1e-14 && (x[1] - 2.0).abs() < 1e-14);
        // JᵀJ = [[4, 6], [6, 14]], inverse = [[14, -6], [-6, 4]] / 20.
        let gram = triangle.inverse_gram().unwrap();
        assert!((gram[0][0] - 0.7).abs() < 1e-15);
        assert!((gram[0][1] + 0.3).abs() < 1e-15);
        assert!((gram[1][1] - 0.2).abs() < 1e-15);
    }

    /// Rows that fill blocks, and some over: the triangle has the same RᵀR and Rᵀ(Qᵀb) as sums
    /// over all rows have, whatever their number.
    #[test]
    fn triangle_of_any_number_of_rows() {
        for n in [1, 3, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 2] {
            let mut qr = Qr::<3>::new();
            let (mut gram, mut right) = ([[0.0; 3]; 3], [0.0; 3]);
            for i in 0..n {
                let t = count(i);
                let (row, b) = ([1.0, t - 2.5, 0.25 * t * t - 3.0], 7.0 - t);
                qr.add(row, b);
                gram = added(&gram, &row);
                for j in 0..3 {
                    right[j] += row[j] * b;
                }
            }
            let Triangle { r, rhs } = qr.triangle();
            for i in 0..3 {
                let back: f64 = (0..=i).map(|k| r[k][i] * rhs[k]).sum();
                let scale = 1e-14 * (1.0 + gram[i][i]) * 1e3_f64.sqrt();
                assert!((back - right[i]).abs() <= scale, "{n}: {back} {}", right[i]);
                for j in 0..3 {
                    let back: f64 = (0..=i.min(j)).map(|k| r[k][i] * r[k][j]).sum();
                    let scale = 1e-14 * (gram[i][i] * gram[j][j]).sqrt();
                    assert!((back - gram[i][j]).abs() <= scale, "{n}: {i} {j}");
                }
            }
        }
    }

    #[test]
    fn cholesky_refuses_what_is_not_positive_definite() {
        assert!(Cholesky::new(&[[1.0, 2.0], [2.0, 1.0]]).is_none());
        assert!(Cholesky::new(&[[1.0, 1.0], [1.0, 1.0]]).is_none());
        assert!(Cholesky::new(&[[f64::NAN, 0.0], [0.0, 1.0]]).is_none());
        let x = Cholesky::new(&[[4.0, 2.0], [2.0, 3.0]])
            .unwrap()
            .solve(&[8.0, 8.0]);
        assert!((x[0] - 1.0).abs() < 1e-15 && (x[1] - 2.0).abs() < 1e-15);
    }
}
