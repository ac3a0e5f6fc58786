//! Sums of products with as few terms as an error allows.

use nalgebra::DMatrix;

/// `sum_k left_k (x) right_k` with fewer terms, to a relative error in the Frobenius norm: the singular value decomposition,
/// by way of the orthogonal factors of both sides. Columns are terms.
pub(super) fn compress(left: DMatrix<f64>, right: DMatrix<f64>, error: f64) -> Option<[DMatrix<f64>; 2]> {
    let (left, right) = (left.qr(), right.qr());
    let core = left.r() * right.r().transpose();
    let svd = core.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let values = &svd.singular_values;
    let total = values.norm_squared();
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    let mut rest = total;
    let mut kept = Vec::new();
    for term in order {
        if rest <= error * error * total {
            break;
        }
        rest -= values[term].powi(2);
        kept.push(term);
    }
    let mut u = u.select_columns(&kept);
    for (column, &term) in kept.iter().enumerate() {
        u.column_mut(column).scale_mut(values[term]);
    }
    let v = v_t.select_rows(&kept).transpose();
    Some([left.q() * u, right.q() * v])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_is_kept_and_terms_are_saved() {
        let side = |shift: f64| {
            DMatrix::from_fn(40, 12, |row, column| {
                (-(row as f64 * 0.01 + shift) * (1.0 + column as f64)).exp()
            })
        };
        let (left, right) = (side(0.05), side(0.1));
        let whole = &left * right.transpose();
        let [few_left, few_right] = compress(left, right, 1e-4).unwrap();
        let error = (&few_left * few_right.transpose() - &whole).norm() / whole.norm();
        assert!(error <= 1e-4, "{error}");
        assert!(few_left.ncols() <= 4, "{} terms", few_left.ncols());
    }
}
