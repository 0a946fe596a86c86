//! Linear least squares.

/// Factors of the columns whose sum comes nearest to either right side, by orthogonalising them one after the other
/// [Golub & Van Loan, Matrix Computations, sec. 5.2.8]. A column that the others before it explain gets none.
pub(crate) fn least_squares(mut columns: Vec<Vec<f64>>, mut rights: [Vec<f64>; 2]) -> Vec<[f64; 2]> {
    const DEPENDENT: f64 = 1e-10;
    let count = columns.len();
    let mut triangle = vec![vec![0.0; count]; count];
    let mut projected = vec![[0.0; 2]; count];
    for k in 0..count {
        let (done, rest) = columns.split_at_mut(k + 1);
        let column = &mut done[k];
        let (full, length) = (triangle[..k].iter().map(|row| row[k] * row[k]).sum::<f64>(), dot(column, column));
        if length <= DEPENDENT * DEPENDENT * (full + length) {
            continue;
        }
        let length = length.sqrt();
        triangle[k][k] = length;
        column.iter_mut().for_each(|value| *value /= length);
        for (j, other) in rest.iter_mut().enumerate() {
            triangle[k][k + 1 + j] = take_out(column, other);
        }
        projected[k] = [take_out(column, &mut rights[0]), take_out(column, &mut rights[1])];
    }
    let mut factors = vec![[0.0; 2]; count];
    for k in (0..count).rev().filter(|k| triangle[*k][*k] > 0.0) {
        factors[k] = [0, 1].map(|axis| {
            let later: f64 = (k + 1..count).map(|j| triangle[k][j] * factors[j][axis]).sum();
            (projected[k][axis] - later) / triangle[k][k]
        });
    }
    factors
}

/// Takes what is along `unit` out of `values`, and tells how much it was.
fn take_out(unit: &[f64], values: &mut [f64]) -> f64 {
    let along = dot(unit, values);
    values.iter_mut().zip(unit).for_each(|(value, unit)| *value -= along * unit);
    along
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
