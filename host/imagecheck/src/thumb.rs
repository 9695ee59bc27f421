//! The Thumb instructions that call functions or move the stack pointer.
//!
//! Encodings from the Armv7-M Architecture Reference Manual (DDI 0403), chapter A7; that of
//! the Armv6-M is a part of it, and the Armv8-M keeps all that is here.

/// What an instruction does, as far as it matters here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Does {
    /// Calls the function at this address.
    Calls(u64),
    /// Jumps to this address.
    Jumps(u64),
    /// Calls what a register says.
    CallsSomewhere,
    /// Jumps to what a register or the memory says.
    JumpsSomewhere,
    /// Goes back to the caller.
    Returns,
    /// Takes this many bytes of stack.
    Pushes(u32),
    /// Takes as much stack as a register says.
    PushesSome,
    /// Sets the lower half of a register.
    SetsLow(u8, u16),
    /// Sets the upper half of a register.
    SetsHigh(u8, u16),
    /// Nothing of interest.
    Else,
}

/// Decodes the instruction at the start of `code`, which lies at `address`; returns its
/// length too. `None` at the end of the code.
pub fn decode(code: &[u8], address: u64) -> Option<(Does, usize)> {
    let first = half(code, 0)?;
    if first >> 11 < 0b11101 {
        return Some((decode_short(first, address), 2));
    }
    Some((decode_long(first, half(code, 2)?, address), 4))
}

fn half(code: &[u8], at: usize) -> Option<u16> {
    let bytes = code.get(at..at + 2)?;
    Some(u16::from_le_bytes(bytes.try_into().ok()?))
}

const LR: u16 = 14;

fn decode_short(code: u16, address: u64) -> Does {
    let register = code >> 3 & 0xF;
    match code {
        // B<c>: eight bits; with 14 and 15 for a condition it is UDF and SVC.
        0xD000..=0xDDFF => Does::Jumps(to(address, signed(u32::from(code & 0xFF) << 1, 9))),
        // B: eleven bits.
        0xE000..=0xE7FF => Does::Jumps(to(address, signed(u32::from(code & 0x7FF) << 1, 12))),
        // BX and BLX; BX LR returns.
        0x4700..=0x477F if register == LR => Does::Returns,
        0x4700..=0x477F if code & 7 == 0 => Does::JumpsSomewhere,
        0x4780..=0x47FF if code & 7 == 0 => Does::CallsSomewhere,
        // POP with PC.
        0xBD00..=0xBDFF => Does::Returns,
        // MOV PC, LR; from another register it is a table of jumps.
        0x46F7 => Does::Returns,
        // PUSH, with or without LR.
        0xB400..=0xB5FF => Does::Pushes((code & 0x1FF).count_ones() * 4),
        // SUB SP, #imm
        0xB080..=0xB0FF => Does::Pushes(u32::from(code & 0x7F) * 4),
        // ADD SP, Rm: how Armv6-M makes room for a large frame, with a negative number.
        _ if code & 0xFF87 == 0x4485 => Does::PushesSome,
        _ => Does::Else,
    }
}

fn decode_long(first: u16, second: u16, address: u64) -> Does {
    let [wide_first, wide_second] = [first, second].map(u32::from);
    let count = (wide_second & 0xFF) * 4;
    if first & 0xF800 == 0xF000 && second & 0x8000 != 0 {
        return match (second & 0x5000, first >> 6 & 0xF) {
            // BL, B.W
            (0x5000, _) => Does::Calls(to(address, far(wide_first, wide_second))),
            (0x1000, _) => Does::Jumps(to(address, far(wide_first, wide_second))),
            // B<c>.W; with 14 and 15 for a condition it is something else.
            (0, 0..=13) => Does::Jumps(to(address, near(wide_first, wide_second))),
            _ => Does::Else,
        };
    }
    match first {
        // LDMIA SP!, {…}, which is POP.W, with PC.
        0xE8BD if second & 0x8000 != 0 => Does::Returns,
        // STMDB SP!, {…}, which is PUSH.W
        0xE92D => Does::Pushes(second.count_ones() * 4),
        // STR Rt, [SP, #-imm]!
        0xF84D if second & 0x0F00 == 0x0D00 => Does::Pushes(wide_second & 0xFF),
        // STRD Rt, Rt2, [SP, #-imm]!
        0xE96D => Does::Pushes(count),
        // VPUSH, of singles or doubles.
        0xED2D | 0xED6D if second & 0x0E00 == 0x0A00 => Does::Pushes(count),
        // SUB.W SP, SP, #imm and SUBW SP, SP, #imm
        _ if first & 0xFBEF == 0xF1AD && second & 0x8F00 == 0x0D00 => {
            Does::Pushes(expanded(constant(wide_first, wide_second)))
        }
        _ if first & 0xFBFF == 0xF2AD && second & 0x8F00 == 0x0D00 => {
            Does::Pushes(constant(wide_first, wide_second))
        }
        // SUB.W SP, SP, Rm
        0xEBAD if second & 0x0F00 == 0x0D00 => Does::PushesSome,
        // MOVW, MOVT
        _ if matches!(first & 0xFBF0, 0xF240 | 0xF2C0) && second & 0x8000 == 0 => {
            let value = (first & 0xF) << 12 | constant(wide_first, wide_second) as u16;
            let register = (second >> 8 & 0xF) as u8;
            if first & 0x80 == 0 {
                Does::SetsLow(register, value)
            } else {
                Does::SetsHigh(register, value)
            }
        }
        // LDR PC, […]; LDR PC, [SP], #imm returns.
        _ if first & 0xFF70 == 0xF850 && second >> 12 == 15 => {
            if first & 0xF == 13 {
                Does::Returns
            } else {
                Does::JumpsSomewhere
            }
        }
        _ => Does::Else,
    }
}

fn to(address: u64, offset: i64) -> u64 {
    address.wrapping_add(4).wrapping_add_signed(offset)
}

/// The number in the lowest `bits` bits.
fn signed(value: u32, bits: u32) -> i64 {
    i64::from((value << (32 - bits)) as i32 >> (32 - bits))
}

/// The offset of `BL` T1 and of `B` T4: 25 bits.
fn far(first: u32, second: u32) -> i64 {
    let sign = first >> 10 & 1;
    let [i1, i2] = [13, 11].map(|bit| 1 ^ (second >> bit & 1) ^ sign);
    let offset = sign << 24 | i1 << 23 | i2 << 22 | (first & 0x3FF) << 12 | (second & 0x7FF) << 1;
    signed(offset, 25)
}

/// The offset of `B` T3: 21 bits.
fn near(first: u32, second: u32) -> i64 {
    let (sign, j1, j2) = (first >> 10 & 1, second >> 13 & 1, second >> 11 & 1);
    let offset = sign << 20 | j2 << 19 | j1 << 18 | (first & 0x3F) << 12 | (second & 0x7FF) << 1;
    signed(offset, 21)
}

/// The twelve bits i:imm3:imm8.
fn constant(first: u32, second: u32) -> u32 {
    (first >> 10 & 1) << 11 | (second >> 12 & 7) << 8 | second & 0xFF
}

/// A modified immediate constant (A5.3.2).
fn expanded(constant: u32) -> u32 {
    let byte = constant & 0xFF;
    match constant >> 8 {
        0 => byte,
        1 => byte * 0x0001_0001,
        2 => byte * 0x0100_0100,
        3 => byte * 0x0101_0101,
        _ => (0x80 | constant & 0x7F).rotate_right(constant >> 7),
    }
}

#[cfg(test)]
mod tests {
    use super::Does::{
        Calls, CallsSomewhere, Else, Jumps, JumpsSomewhere, Pushes, PushesSome, Returns, SetsHigh,
        SetsLow,
    };
    use super::*;

    fn short(code: u16) -> Does {
        let (does, length) = decode(&code.to_le_bytes(), 0x1000).unwrap();
        assert_eq!(length, 2, "{code:04x}");
        does
    }

    fn long(first: u16, second: u16) -> Does {
        let code = [first.to_le_bytes(), second.to_le_bytes()].concat();
        let (does, length) = decode(&code, 0x0200_0000).unwrap();
        assert_eq!(length, 4, "{first:04x} {second:04x}");
        does
    }

    /// Where a long branch leads, from its own address plus 4.
    fn offset(first: u16, second: u16) -> Option<i64> {
        match long(first, second) {
            Calls(to) | Jumps(to) => Some(to as i64 - 0x0200_0004),
            _ => None,
        }
    }

    /// Branches as an assembler gives them: near, far, backwards, conditional.
    #[test]
    fn branches() {
        assert_eq!(short(0xE000), Jumps(0x1004)); // b .+4
        assert_eq!(short(0xE7FE), Jumps(0x1000)); // b .
        assert_eq!(short(0xD1FE), Jumps(0x1000)); // bne .
        assert_eq!(short(0xDEFE), Else); // udf
        assert_eq!(short(0xDF00), Else); // svc
        assert_eq!(offset(0xF000, 0xF800), Some(0)); // bl .+4
        assert_eq!(offset(0xF000, 0xF880), Some(0x100)); // bl .+0x104
        assert_eq!(offset(0xF7FF, 0xFFFE), Some(-4)); // bl .
        assert_eq!(offset(0xF001, 0xB800), Some(0x1000)); // b.w .+0x1004
        // the farthest: -16 MiB and +16 MiB - 2
        assert_eq!(offset(0xF400, 0xD000), Some(-(1 << 24)));
        assert_eq!(offset(0xF3FF, 0xD7FF), Some((1 << 24) - 2));
        assert_eq!(offset(0xF43F, 0xAFFE), Some(-4)); // beq.w .
        assert_eq!(long(0xF000, 0xF800), Calls(0x0200_0004));
        assert_eq!(long(0xF000, 0xB800), Jumps(0x0200_0004));
        assert_eq!(offset(0xF000, 0xE800), None); // blx, which Cortex-M does not have
        assert_eq!(offset(0xF3BF, 0x8F4F), None); // dsb
        assert_eq!(offset(0xF3EF, 0x8010), None); // mrs r0, primask
    }

    /// What leads where only a register knows, and what leads back.
    #[test]
    fn indirect() {
        assert_eq!(short(0x4780), CallsSomewhere); // blx r0
        assert_eq!(short(0x4718), JumpsSomewhere); // bx r3
        assert_eq!(long(0xF8D3, 0xF00C), JumpsSomewhere); // ldr.w pc, [r3, #12]
        assert_eq!(short(0x4687), Else); // mov pc, r0: a table of jumps
        assert_eq!(short(0x4770), Returns); // bx lr
        assert_eq!(short(0x46F7), Returns); // mov pc, lr
        assert_eq!(short(0xBD10), Returns); // pop {r4, pc}
        assert_eq!(short(0xBC10), Else); // pop {r4}
        assert_eq!(long(0xE8BD, 0x83F0), Returns); // pop.w {r4-r9, pc}
        assert_eq!(long(0xE8BD, 0x0F00), Else); // pop.w {r8-r11}
        assert_eq!(long(0xF85D, 0xFB04), Returns); // ldr pc, [sp], #4
    }

    /// What a prologue takes.
    #[test]
    fn prologues() {
        assert_eq!(short(0xB5F0), Pushes(20)); // push {r4-r7, lr}
        assert_eq!(short(0xB082), Pushes(8)); // sub sp, #8
        assert_eq!(short(0xB002), Else); // add sp, #8
        assert_eq!(short(0x44BD), PushesSome); // add sp, r7
        assert_eq!(long(0xE92D, 0x0F00), Pushes(16)); // push.w {r8-r11}
        assert_eq!(long(0xF84D, 0xBD04), Pushes(4)); // str r11, [sp, #-4]!
        assert_eq!(long(0xED2D, 0x8B04), Pushes(16)); // vpush {d8, d9}
        assert_eq!(long(0xF5AD, 0x5D80), Pushes(4096)); // sub.w sp, sp, #4096
        assert_eq!(long(0xF2AD, 0x4D14), Pushes(1044)); // subw sp, sp, #1044
    }

    /// The two halves of an address.
    #[test]
    fn halves() {
        assert_eq!(long(0xF241, 0x2034), SetsLow(0, 0x1234)); // movw r0, #0x1234
        assert_eq!(long(0xF2C2, 0x0101), SetsHigh(1, 0x2001)); // movt r1, #0x2001
        assert_eq!(long(0xF64F, 0x7CFF), SetsLow(12, 0xFFFF)); // movw r12, #0xffff
    }
}
