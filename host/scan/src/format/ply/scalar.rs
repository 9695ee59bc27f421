//! The numbers of a PLY file.

/// How the numbers behind the header are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// The type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    /// The type by one of its two names.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of one.
    pub const fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number in the first bytes, which are as many as its size at least.
    pub fn read(self, bytes: &[u8], encoding: Encoding) -> f64 {
        let size = self.size();
        let mut b = [0_u8; 8];
        b[..size].copy_from_slice(&bytes[..size]);
        if encoding == Encoding::BigEndian {
            b[..size].reverse();
        }
        let [b0, b1, b2, b3, ..] = b;
        match self {
            Self::I8 => f64::from(b0.cast_signed()),
            Self::U8 => f64::from(b0),
            Self::I16 => f64::from(i16::from_le_bytes([b0, b1])),
            Self::U16 => f64::from(u16::from_le_bytes([b0, b1])),
            Self::I32 => f64::from(i32::from_le_bytes([b0, b1, b2, b3])),
            Self::U32 => f64::from(u32::from_le_bytes([b0, b1, b2, b3])),
            Self::F32 => f64::from(f32::from_le_bytes([b0, b1, b2, b3])),
            Self::F64 => f64::from_le_bytes(b),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_reads_its_least_and_its_greatest_number_in_both_orders() {
        let cases: [(Scalar, Vec<u8>, f64); 9] = [
            (Scalar::I8, vec![0x80], -128.0),
            (Scalar::U8, vec![0xff], 255.0),
            (Scalar::I16, i16::MIN.to_le_bytes().to_vec(), -32768.0),
            (Scalar::U16, u16::MAX.to_le_bytes().to_vec(), 65535.0),
            (
                Scalar::I32,
                i32::MIN.to_le_bytes().to_vec(),
                -2_147_483_648.0,
            ),
            (
                Scalar::U32,
                u32::MAX.to_le_bytes().to_vec(),
                4_294_967_295.0,
            ),
            (Scalar::F32, (-0.5_f32).to_le_bytes().to_vec(), -0.5),
            (Scalar::F64, 1e300_f64.to_le_bytes().to_vec(), 1e300),
            (Scalar::F64, (-1.25_f64).to_le_bytes().to_vec(), -1.25),
        ];
        for (kind, little, number) in cases {
            let mut big = little.clone();
            big.reverse();
            assert_eq!(
                kind.read(&little, Encoding::LittleEndian),
                number,
                "{kind:?}"
            );
            assert_eq!(kind.read(&big, Encoding::BigEndian), number, "{kind:?}");
        }
    }
}
