//! What the schema says is what serde writes.
//!
//! The schema comes from one derive and the bytes from another. Here bytes are
//! made from the schema alone and must be read as a message and written again,
//! the same to the last byte. The longest bytes that the schema allows are the
//! worst case: all lists and texts full, all numbers at their longest, of each
//! enum the longest variant.

use serde::{Serialize, de::DeserializeOwned};
use umi_protocol::Schema;
use umi_protocol::decoder::Decoder;
use umi_protocol::frame::{MAX_BOARD_FRAME, MAX_HOST_FRAME, Message, encode};
use umi_protocol::hello::Hello;
use umi_protocol::message::{Event, MAX_ENTRY, MAX_RECORD, Record, Request, Response};
use umi_protocol::schema::{DataModelType, DataModelVariant, NamedType, NamedValue, max_len};

/// A number in postcard's variable-length form.
fn varint(mut number: u64) -> Vec<u8> {
    let mut out = Vec::new();
    while number > 0x7f {
        out.push(number as u8 | 0x80);
        number >>= 7;
    }
    out.push(number as u8);
    out
}

/// The longest bytes that a type allows.
fn longest(of: &NamedType) -> Vec<u8> {
    match of.ty {
        DataModelType::Bool => vec![1],
        DataModelType::U8 => vec![u8::MAX],
        DataModelType::U16 => varint(u16::MAX.into()),
        // Zigzag writes the most negative number as the largest.
        DataModelType::U32 | DataModelType::I32 => varint(u32::MAX.into()),
        DataModelType::U64 | DataModelType::I64 => varint(u64::MAX),
        DataModelType::F64 => f64::MIN.to_le_bytes().to_vec(),
        DataModelType::Text { capacity } => {
            let mut out = varint(*capacity as u64);
            out.extend(std::iter::repeat_n(b'~', *capacity));
            out
        }
        DataModelType::List { capacity, item } => {
            let mut out = varint(*capacity as u64);
            out.extend(longest(item).repeat(*capacity));
            out
        }
        DataModelType::Array { len, item } => longest(item).repeat(*len),
        DataModelType::Option(inner) => [vec![1], longest(inner)].concat(),
        DataModelType::UnitStruct => vec![],
        DataModelType::NewtypeStruct(inner) => longest(inner),
        DataModelType::TupleStruct(types) => types.iter().flat_map(|of| longest(of)).collect(),
        DataModelType::Struct(fields) => fields.iter().flat_map(|f| longest(f.ty)).collect(),
        DataModelType::Enum(variants) => variants
            .iter()
            .enumerate()
            .map(|(number, variant)| {
                let mut out = varint(number as u64);
                out.extend(match variant.ty {
                    DataModelVariant::UnitVariant => vec![],
                    DataModelVariant::NewtypeVariant(inner) => longest(inner),
                    DataModelVariant::TupleVariant(types) => {
                        types.iter().flat_map(|of| longest(of)).collect()
                    }
                    DataModelVariant::StructVariant(fields) => {
                        fields.iter().flat_map(|f| longest(f.ty)).collect()
                    }
                });
                out
            })
            .max_by_key(Vec::len)
            .unwrap(),
    }
}

/// Bytes in which every variant of every enum in a type occurs, every option is
/// once empty and once full, and every list once empty and once not. Numbers
/// count up, so that no two neighbours are alike.
pub fn every_variant(of: &NamedType, count: &mut u8) -> Vec<Vec<u8>> {
    *count = *count % 100 + 1;
    let number = *count;
    match of.ty {
        DataModelType::Bool => vec![vec![0], vec![1]],
        DataModelType::U8
        | DataModelType::U16
        | DataModelType::U32
        | DataModelType::U64
        | DataModelType::I32
        | DataModelType::I64 => vec![vec![number]],
        DataModelType::F64 => vec![f64::from(number).to_le_bytes().to_vec()],
        DataModelType::Text { .. } => vec![vec![0], vec![1, number + 20]],
        DataModelType::List { capacity, item } => {
            let items = every_variant(item, count);
            let mut out = vec![vec![0]];
            for some in items.chunks(*capacity) {
                out.push([varint(some.len() as u64), some.concat()].concat());
            }
            out
        }
        DataModelType::Array { len, item } => {
            let same: Vec<&NamedType> = vec![*item; *len];
            sequence(&same, count)
        }
        DataModelType::Option(inner) => {
            let mut out = vec![vec![0]];
            for some in every_variant(inner, count) {
                out.push([vec![1], some].concat());
            }
            out
        }
        DataModelType::UnitStruct => vec![vec![]],
        DataModelType::NewtypeStruct(inner) => every_variant(inner, count),
        DataModelType::TupleStruct(types) => sequence(types, count),
        DataModelType::Struct(fields) => sequence(&types(fields), count),
        DataModelType::Enum(variants) => {
            let mut out = Vec::new();
            for (number, variant) in variants.iter().enumerate() {
                let contents = match variant.ty {
                    DataModelVariant::UnitVariant => vec![vec![]],
                    DataModelVariant::NewtypeVariant(inner) => every_variant(inner, count),
                    DataModelVariant::TupleVariant(types) => sequence(types, count),
                    DataModelVariant::StructVariant(fields) => sequence(&types(fields), count),
                };
                for content in contents {
                    out.push([varint(number as u64), content].concat());
                }
            }
            out
        }
    }
}

fn types(fields: &[&NamedValue]) -> Vec<&'static NamedType> {
    fields.iter().map(|field| field.ty).collect()
}

/// Values one after the other: as many as the one with the most variants needs.
fn sequence(types: &[&NamedType], count: &mut u8) -> Vec<Vec<u8>> {
    let columns: Vec<Vec<Vec<u8>>> = types.iter().map(|of| every_variant(of, count)).collect();
    let rows = columns.iter().map(Vec::len).max().unwrap_or(1);
    (0..rows)
        .map(|row| {
            columns
                .iter()
                .flat_map(|column| column[row % column.len()].clone())
                .collect()
        })
        .collect()
}

/// Reads bytes as a message and writes it again.
fn there_and_back<T: Serialize + DeserializeOwned>(bytes: &[u8]) -> T {
    let (value, rest) = postcard::take_from_bytes::<T>(bytes).unwrap();
    assert!(rest.is_empty(), "{} bytes are left over", rest.len());
    let mut buffer = vec![0; bytes.len() + 1];
    assert_eq!(postcard::to_slice(&value, &mut buffer).unwrap(), bytes);
    value
}

/// Every variant of every type, however deep, is written as the schema says.
#[test]
fn serde_writes_what_the_schema_says() {
    fn check<T: Schema + Serialize + DeserializeOwned>(least: usize) {
        let all = every_variant(T::SCHEMA, &mut 0);
        for bytes in &all {
            there_and_back::<T>(bytes);
        }
        assert!(all.len() >= least, "{} of {}", all.len(), T::SCHEMA.name);
    }
    check::<Hello>(1);
    check::<Request>(10);
    check::<Response>(60);
    check::<Event>(60);
    check::<Record>(60);
}

/// No message is longer than its computed length, and the longest one is exactly
/// that long and fits its frame.
#[test]
fn the_longest_messages_fit() {
    fn check<M: Message, const N: usize>() {
        let bytes = longest(M::SCHEMA);
        assert_eq!(bytes.len(), M::MAX_LEN, "{}", M::SCHEMA.name);
        let message: M = there_and_back(&bytes);
        let mut buffer = [0; N];
        let mut frame = encode(u16::MAX, &message, &mut buffer).unwrap();
        let mut decoder = Decoder::<N>::new();
        let back = decoder.next_frame(&mut frame).unwrap();
        assert_eq!(back.payload, bytes);
        assert!(back.open::<M>().is_ok());
    }
    check::<Hello, MAX_HOST_FRAME>();
    check::<Hello, MAX_BOARD_FRAME>();
    check::<Request, MAX_HOST_FRAME>();
    check::<Response, MAX_BOARD_FRAME>();
    check::<Event, MAX_BOARD_FRAME>();
}

/// A journal has room for every record, and the link for every entry.
#[test]
fn the_longest_record_fits_the_journal_and_the_link() {
    let bytes = longest(Record::SCHEMA);
    assert_eq!(bytes.len(), MAX_RECORD);
    let record: Record = there_and_back(&bytes);
    assert!(
        matches!(record, Record::Verdict(_)),
        "the longest is a verdict"
    );
    const { assert!(MAX_RECORD < MAX_ENTRY && MAX_ENTRY < Response::MAX_LEN) };
    assert_eq!(max_len::<Record>(), MAX_RECORD);
}

/// One item more than a list holds is refused, not cut.
#[test]
fn a_list_that_is_too_long_is_refused() {
    let refused = |bytes: &[u8]| postcard::take_from_bytes::<heapless::Vec<u8, 3>>(bytes).is_err();
    assert!(!refused(&[3, 1, 2, 3]));
    assert!(refused(&[4, 1, 2, 3, 4]));
}
