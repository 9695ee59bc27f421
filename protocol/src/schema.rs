//! The schema of every message, and the key and the sizes that follow from it.
//!
//! Board and host are flashed and installed at different times. Postcard writes
//! values without names, so a host that knows another order of fields would read
//! wrong numbers and never notice. Therefore each message type describes itself
//! (`#[derive(Schema)]`), and [`key`] condenses the description to 64 bits that
//! both sides compare: names of fields and variants (thus the units in them),
//! their order, the number types and the capacities of lists and texts. Names of
//! types do not count: they never change a byte.
//!
//! From the same description [`max_len`] computes how long an encoded message
//! can be, so that no buffer size is typed by hand.
//!
//! The derive is that of the `postcard-schema` crate. The trait and the
//! description are ours, because the description there knows no capacities and
//! covers heapless lists only with their default length type; the derive's
//! `#[postcard(crate = crate)]` makes it write our types, whose names and shapes
//! it dictates. `serde(rename)` is respected; other serde attributes that change
//! what is written (`skip`, `flatten`, `with`) would escape it and must not be
//! used on messages. A test compares the lengths computed here with those of
//! real worst-case messages.

use heapless::{LenType, String, Vec};

/// A type that describes how it is written.
pub trait Schema {
    /// The description.
    const SCHEMA: &'static NamedType;
}

/// A type: its name (for people only) and how it is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NamedType {
    /// Name, not part of the key.
    pub name: &'static str,
    /// How it is written.
    pub ty: &'static DataModelType,
}

/// How a value is written (postcard wire format 1.0).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataModelType {
    /// One byte, 0 or 1.
    Bool,
    /// One byte.
    U8,
    /// Variable length, at most 3 bytes.
    U16,
    /// Variable length, at most 5 bytes.
    U32,
    /// Variable length, at most 10 bytes.
    U64,
    /// Zigzag, variable length, at most 5 bytes.
    I32,
    /// Zigzag, variable length, at most 10 bytes.
    I64,
    /// Eight bytes, IEEE 754, little-endian.
    F64,
    /// Length and UTF-8 bytes.
    Text {
        /// Bytes, at most.
        capacity: usize,
    },
    /// Length and items.
    List {
        /// Items, at most.
        capacity: usize,
        /// The item.
        item: &'static NamedType,
    },
    /// Items without a length.
    Array {
        /// Items, exactly.
        len: usize,
        /// The item.
        item: &'static NamedType,
    },
    /// One byte, 0 or 1, and after 1 the value.
    Option(&'static NamedType),
    /// Nothing.
    UnitStruct,
    /// The inner value.
    NewtypeStruct(&'static NamedType),
    /// The values in their order.
    TupleStruct(&'static [&'static NamedType]),
    /// The fields in their order.
    Struct(&'static [&'static NamedValue]),
    /// The number of the variant (as a u32) and its fields.
    Enum(&'static [&'static NamedVariant]),
}

/// How the fields of a variant are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataModelVariant {
    /// Nothing.
    UnitVariant,
    /// The inner value.
    NewtypeVariant(&'static NamedType),
    /// The values in their order.
    TupleVariant(&'static [&'static NamedType]),
    /// The fields in their order.
    StructVariant(&'static [&'static NamedValue]),
}

/// A field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NamedValue {
    /// Its name, with its unit.
    pub name: &'static str,
    /// Its type.
    pub ty: &'static NamedType,
}

/// A variant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NamedVariant {
    /// Its name.
    pub name: &'static str,
    /// Its fields.
    pub ty: &'static DataModelVariant,
}

macro_rules! numbers {
    ($($number:ty => $model:ident),* $(,)?) => {$(
        impl Schema for $number {
            const SCHEMA: &'static NamedType = &NamedType {
                name: stringify!($number),
                ty: &DataModelType::$model,
            };
        }
    )*};
}

numbers! {
    bool => Bool, u8 => U8, u16 => U16, u32 => U32, u64 => U64,
    i32 => I32, i64 => I64, f64 => F64,
}

impl<T: Schema> Schema for Option<T> {
    const SCHEMA: &'static NamedType = &NamedType {
        name: "Option",
        ty: &DataModelType::Option(T::SCHEMA),
    };
}

impl<T: Schema, const N: usize> Schema for [T; N] {
    const SCHEMA: &'static NamedType = &NamedType {
        name: "array",
        ty: &DataModelType::Array {
            len: N,
            item: T::SCHEMA,
        },
    };
}

impl<T: Schema, const N: usize, LenT: LenType> Schema for Vec<T, N, LenT> {
    const SCHEMA: &'static NamedType = &NamedType {
        name: "Vec",
        ty: &DataModelType::List {
            capacity: N,
            item: T::SCHEMA,
        },
    };
}

impl<const N: usize, LenT: LenType> Schema for String<N, LenT> {
    const SCHEMA: &'static NamedType = &NamedType {
        name: "String",
        ty: &DataModelType::Text { capacity: N },
    };
}

impl<A: Schema, B: Schema, C: Schema> Schema for (A, B, C) {
    const SCHEMA: &'static NamedType = &NamedType {
        name: "tuple",
        ty: &DataModelType::TupleStruct(&[A::SCHEMA, B::SCHEMA, C::SCHEMA]),
    };
}

/// The key of a type: equal keys mean equal bytes and equal meaning of them.
///
/// FNV-1a, 64 bits, over an unambiguous writing of the description: each node
/// begins with a tag of its own, and names and counts are written with their
/// length. It guards against mistakes, not against an attacker.
#[must_use]
pub const fn key<T: Schema>() -> u64 {
    hash_type(FNV_BASIS, T::SCHEMA)
}

/// Bytes of the longest encoded value of a type.
#[must_use]
pub const fn max_len<T: Schema>() -> usize {
    max_len_type(T::SCHEMA)
}

const fn max_len_type(of: &NamedType) -> usize {
    match of.ty {
        DataModelType::Bool | DataModelType::U8 => 1,
        DataModelType::U16 => 3,
        DataModelType::U32 | DataModelType::I32 => 5,
        DataModelType::U64 | DataModelType::I64 => 10,
        DataModelType::F64 => 8,
        DataModelType::Text { capacity } => varint_len(*capacity) + *capacity,
        DataModelType::List { capacity, item } => {
            varint_len(*capacity) + *capacity * max_len_type(item)
        }
        DataModelType::Array { len, item } => *len * max_len_type(item),
        DataModelType::Option(inner) => 1 + max_len_type(inner),
        DataModelType::UnitStruct => 0,
        DataModelType::NewtypeStruct(inner) => max_len_type(inner),
        DataModelType::TupleStruct(types) => max_len_types(types),
        DataModelType::Struct(fields) => max_len_fields(fields),
        DataModelType::Enum(variants) => {
            let mut longest = 0;
            let mut rest = *variants;
            let mut number = 0;
            while let Some((variant, others)) = rest.split_first() {
                let len = varint_len(number) + max_len_variant(variant.ty);
                if len > longest {
                    longest = len;
                }
                number += 1;
                rest = others;
            }
            longest
        }
    }
}

const fn max_len_variant(variant: &DataModelVariant) -> usize {
    match variant {
        DataModelVariant::UnitVariant => 0,
        DataModelVariant::NewtypeVariant(inner) => max_len_type(inner),
        DataModelVariant::TupleVariant(types) => max_len_types(types),
        DataModelVariant::StructVariant(fields) => max_len_fields(fields),
    }
}

const fn max_len_types(types: &[&NamedType]) -> usize {
    let mut sum = 0;
    let mut rest = types;
    while let Some((first, others)) = rest.split_first() {
        sum += max_len_type(first);
        rest = others;
    }
    sum
}

const fn max_len_fields(fields: &[&NamedValue]) -> usize {
    let mut sum = 0;
    let mut rest = fields;
    while let Some((first, others)) = rest.split_first() {
        sum += max_len_type(first.ty);
        rest = others;
    }
    sum
}

/// Bytes of a number in postcard's variable-length form: seven bits to a byte.
const fn varint_len(number: usize) -> usize {
    let mut len = 1;
    let mut rest = number >> 7;
    while rest > 0 {
        len += 1;
        rest >>= 7;
    }
    len
}

// FNV-1a with 64 bits: Fowler, Noll, Vo; RFC 9923.
const FNV_BASIS: u64 = 0xcbf2_9ce4_8422_2325;
const FNV_PRIME: u64 = 0x0000_0100_0000_01b3;

const fn hash_byte(state: u64, byte: u8) -> u64 {
    (state ^ byte as u64).wrapping_mul(FNV_PRIME)
}

const fn hash_count(state: u64, count: usize) -> u64 {
    let mut state = state;
    let mut rest = count as u64;
    let mut bytes = 0;
    while bytes < 8 {
        state = hash_byte(state, (rest & 0xff) as u8);
        rest >>= 8;
        bytes += 1;
    }
    state
}

const fn hash_name(state: u64, name: &str) -> u64 {
    let mut state = hash_count(state, name.len());
    let mut rest = name.as_bytes();
    while let Some((first, others)) = rest.split_first() {
        state = hash_byte(state, *first);
        rest = others;
    }
    state
}

const fn hash_type(state: u64, of: &NamedType) -> u64 {
    match of.ty {
        DataModelType::Bool => hash_byte(state, 1),
        DataModelType::U8 => hash_byte(state, 2),
        DataModelType::U16 => hash_byte(state, 3),
        DataModelType::U32 => hash_byte(state, 4),
        DataModelType::U64 => hash_byte(state, 5),
        DataModelType::I32 => hash_byte(state, 6),
        DataModelType::I64 => hash_byte(state, 7),
        DataModelType::F64 => hash_byte(state, 8),
        DataModelType::Text { capacity } => hash_count(hash_byte(state, 9), *capacity),
        DataModelType::List { capacity, item } => {
            hash_type(hash_count(hash_byte(state, 10), *capacity), item)
        }
        DataModelType::Array { len, item } => {
            hash_type(hash_count(hash_byte(state, 11), *len), item)
        }
        DataModelType::Option(inner) => hash_type(hash_byte(state, 12), inner),
        DataModelType::UnitStruct => hash_byte(state, 13),
        DataModelType::NewtypeStruct(inner) => hash_type(hash_byte(state, 14), inner),
        DataModelType::TupleStruct(types) => hash_types(hash_byte(state, 15), types),
        DataModelType::Struct(fields) => hash_fields(hash_byte(state, 16), fields),
        DataModelType::Enum(variants) => {
            let mut state = hash_count(hash_byte(state, 17), variants.len());
            let mut rest = *variants;
            while let Some((first, others)) = rest.split_first() {
                state = hash_variant(hash_name(state, first.name), first.ty);
                rest = others;
            }
            state
        }
    }
}

const fn hash_variant(state: u64, variant: &DataModelVariant) -> u64 {
    match variant {
        DataModelVariant::UnitVariant => hash_byte(state, 18),
        DataModelVariant::NewtypeVariant(inner) => hash_type(hash_byte(state, 19), inner),
        DataModelVariant::TupleVariant(types) => hash_types(hash_byte(state, 20), types),
        DataModelVariant::StructVariant(fields) => hash_fields(hash_byte(state, 21), fields),
    }
}

const fn hash_types(state: u64, types: &[&NamedType]) -> u64 {
    let mut state = hash_count(state, types.len());
    let mut rest = types;
    while let Some((first, others)) = rest.split_first() {
        state = hash_type(state, first);
        rest = others;
    }
    state
}

const fn hash_fields(state: u64, fields: &[&NamedValue]) -> u64 {
    let mut state = hash_count(state, fields.len());
    let mut rest = fields;
    while let Some((first, others)) = rest.split_first() {
        state = hash_type(hash_name(state, first.name), first.ty);
        rest = others;
    }
    state
}

#[cfg(test)]
mod tests;
