//! Drawing and typing: elements that always close, primitives, scales, labels, digits.

pub mod labels;
pub mod markup;
pub mod number;
pub mod scale;
pub mod svg;
pub mod text;
