//! Arrays of NumPy that are views of values in Rust. The only unsafe code of this crate.
#![allow(unsafe_code)]

use numpy::ndarray::{ArrayView, Dimension, StrideShape};
use numpy::{Element, PyArray};
use pyo3::PyClass;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::pyclass::boolean_struct::True;

/// A read-only array over values that an object of a frozen class holds, without a copy. The array keeps the object alive.
///
/// # Errors
/// A shape that the values do not fill.
pub(crate) fn view<'py, C, T, D>(
    owner: &Bound<'py, C>,
    values: impl for<'a> FnOnce(&'a C) -> &'a [T],
    shape: impl Into<StrideShape<D>>,
) -> PyResult<Bound<'py, PyArray<T, D>>>
where
    C: PyClass<Frozen = True> + Sync,
    T: Element,
    D: Dimension,
{
    let values = ArrayView::from_shape(shape, values(owner.get()));
    let values = values.map_err(|error| PyValueError::new_err(error.to_string()))?;
    // SAFETY: the values are borrowed from the object for as long as it is shared, which of a frozen class is as long as it lives:
    // until then nothing moves or changes them. The array holds a reference to the object.
    let array = unsafe { PyArray::borrow_from_array(&values, owner.clone().into_any()) };
    array.call_method1("setflags", (false,))?;
    Ok(array)
}
