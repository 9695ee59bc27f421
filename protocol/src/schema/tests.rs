//! What the key sees, and what it must not see.

use postcard_derive::Schema;
use serde::Serialize;

use super::*;

macro_rules! types {
    ($($(#[$attribute:meta])* $name:ident $body:tt)*) => {$(
        #[derive(Schema, Serialize)]
        #[postcard(crate = crate)]
        $(#[$attribute])*
        struct $name $body
    )*};
}

types! {
    Length { radius_mm: f64, hits: u16 }
    OtherName { radius_mm: f64, hits: u16 }
    OtherUnit { radius_um: f64, hits: u16 }
    OtherOrder { hits: u16, radius_mm: f64 }
    OtherNumber { radius_mm: f64, hits: u32 }
    Optional { radius_mm: f64, hits: Option<u16> }
    Short { name: String<8, u8>, list: Vec<u16, 4> }
    LongText { name: String<9, u8>, list: Vec<u16, 4> }
    LongList { name: String<8, u8>, list: Vec<u16, 5> }
    WideLength { name: String<8>, list: Vec<u16, 4, u8> }
}

#[derive(Schema)]
#[postcard(crate = crate)]
#[allow(dead_code, reason = "only described")]
enum Choice {
    One,
    Two(u8),
    Three { at_mm: f64 },
}

#[derive(Schema)]
#[postcard(crate = crate)]
#[allow(dead_code, reason = "only described")]
enum OtherChoice {
    Two(u8),
    One,
    Three { at_mm: f64 },
}

/// Everything that changes bytes or their meaning changes the key.
#[test]
fn the_key_sees_names_units_order_numbers_and_capacities() {
    let keys = [
        key::<Length>(),
        key::<OtherUnit>(),
        key::<OtherOrder>(),
        key::<OtherNumber>(),
        key::<Optional>(),
        key::<Short>(),
        key::<LongText>(),
        key::<LongList>(),
        key::<Choice>(),
        key::<OtherChoice>(),
    ];
    for (i, a) in keys.iter().enumerate() {
        for b in &keys[..i] {
            assert_ne!(a, b, "key {i}");
        }
    }
}

/// The name of a type and the length type of a list never change a byte.
#[test]
fn the_key_ignores_what_is_never_written() {
    assert_eq!(key::<Length>(), key::<OtherName>());
    assert_eq!(key::<Short>(), key::<WideLength>());
}

/// FNV-1a as published, with test vectors of RFC 9923.
#[test]
fn the_hash_is_fnv_1a() {
    let hash = |text: &str| text.bytes().fold(FNV_BASIS, hash_byte);
    assert_eq!(hash(""), 0xcbf2_9ce4_8422_2325);
    assert_eq!(hash("a"), 0xaf63_dc4c_8601_ec8c);
    assert_eq!(hash("foobar"), 0x8594_4171_f739_67e8);
}

/// The longest number in postcard's form has the length that [`max_len`] says.
#[test]
fn the_longest_values_are_as_long_as_computed() {
    fn check<T: Schema + Serialize>(value: &T) {
        let mut buffer = [0; 64];
        let len = postcard::to_slice(value, &mut buffer).unwrap().len();
        assert_eq!(len, max_len::<T>(), "{}", T::SCHEMA.name);
    }
    check(&u8::MAX);
    check(&u16::MAX);
    check(&u32::MAX);
    check(&u64::MAX);
    check(&i32::MIN);
    check(&i64::MIN);
    check(&f64::MAX);
    check(&true);
    check(&Some(u16::MAX));
    check(&[u64::MAX; 3]);
    check(&Short {
        name: String::try_from("12345678").unwrap(),
        list: Vec::from_array([u16::MAX; 4]),
    });
    assert_eq!(max_len::<Choice>(), 9);
    assert_eq!(max_len::<Vec<u8, 127>>(), 128);
    assert_eq!(max_len::<Vec<u8, 128>>(), 130);
}
