//! PIO programs of the state machines.
//!
//! # Quadrature (PIO 0, four machines)
//!
//! ```text
//! cycle    1      2      3        4         5            6            7 ... 10
//!        in x   in y   out isr  in pins   mov osr,isr  mov pc,isr   one of 16
//!        └── push ──┘  └─ before ─┴─ now ─┘  └ keep ┘   └ jump by both ┘
//! ```
//!
//! The four bits "before, now" are the address of the instruction that comes next. What
//! follows from there takes four cycles, whatever it is:
//!
//! | transition | path | cycles |
//! | --- | --- | --- |
//! | none | `jmp update [3]` | 4 |
//! | illegal | `jmp x-- update [3]` | 4 |
//! | down | `jmp down [2]`, `jmp y-- update` | 3 + 1 |
//! | up | `jmp up`, `mov y,~y`, `jmp y--`, `mov y,~y` | 1 + 1 + 1 + 1 |
//!
//! So each machine samples its pins each [`PERIOD_CYCLES`](crate::resources::PERIOD_CYCLES)
//! cycles for ever and pushes a word each time: 14 bits of illegal transitions
//! (inverted: they are counted down) above 18 bits of position. A word holds the
//! position as it was at the sample of the loop before.
//!
//! A `jmp y--` that finds zero does not jump, but goes on below: there is what it would
//! have jumped to. `jmp x--` in the table finds zero once in 2³² illegal transitions;
//! then one transition may be counted wrongly, and the illegal ones tell that it was
//! no good line anyway.
//!
//! # Stamp (PIO 1, two machines)
//!
//! The pin is looked at each two cycles, and between two looks X counts down: it is the time.
//! At an edge 13 bits of the number of edges are pushed above 19 bits of time (both inverted)
//! if there is room, and the edge counts in Y anyway: so what found no room is known from the
//! next that did. The time comes round after 8.4 ms. The number cannot before somebody looks:
//! at one edge in twelve cycles, it has counted 5209 of its 8192 after half a millisecond.
//!
//! Both edges go through the same instructions. What to look for next, the next fall or the next
//! rise, is the address in OSR: the addresses of the two loops are each other's complement
//! ([`stamp::LOW`], [`stamp::HIGH`]), so that `mov osr, ~osr` exchanges them. The probe's machine
//! goes on below its loop at a fall, to where the edges are stamped. The machine of triggers wraps
//! there to `fell`, which stamps nothing.
//!
//! | path | cycles | decrements of X | lost |
//! | --- | --- | --- | --- |
//! | low, still low: `low`, `below` | 2 | 1 | |
//! | high, still high: `watch`, `high` | 2 | 1 | |
//! | an edge that is stamped: `low` or `watch`, `edge` ... | 1 + 11 | 1 | [`stamp::LOST_AT_EDGE`] |
//! | a fall that is not: `watch`, `fell` | 2 | 0 | [`stamp::LOST_AT_FALL`] |
//!
//! What X has lost is known from the number of edges, and given back to the time
//! ([`crate::capture::stamps`]).
//!
//! A pulse must last two cycles. An edge within twelve cycles of the one before is stamped when
//! these are over, if the level is still the other one then: so a spark of 16 ns has both its
//! edges, 96 ns apart. A gap or a pulse in the middle of these twelve is not seen.
//!
//! A `jmp x--` that finds zero, each 69 s, does not jump but goes on below. There is what it would
//! have jumped to; `below` of the probe's machine wraps to it, and that of triggers has a second
//! loop below it, for one turn.
//!
//! # Events (PIO 1, one machine)
//!
//! Looks at five pins in the very cycles in which the decoders look at theirs. X counts
//! those looks down, on both paths, and when a pin has changed, the five levels are pushed
//! above those of the look before and 22 bits of the count (inverted), if there is room. So
//! what a word says is true whatever was pushed before it, or found no room. The time comes
//! round after a third of a second. Y has the levels of the look before; at a start it has
//! others than pins can have, so that the first look is pushed.
//!
//! | path | cycles |
//! | --- | --- |
//! | as before | 4, and 1 + 3 to empty ISR and jump over the push, 2 to count |
//! | changed | 4, and 4 to push, which empties ISR, 2 to count |
//!
//! It begins with the last of these, one cycle before its first look, and a zero in X: that is
//! no jump, but the program goes on at its beginning all the same.
//!
//! # Pulse (PIO 1, one machine)
//!
//! Takes a number from its queue, waits that long, sends a pulse as long as Y says, and again. As
//! long as the queue is not empty, pulses come in exactly [`PULSE_OVERHEAD_CYCLES`] more cycles
//! than the numbers and Y say. OSR is filled by autopull: it holds one number more.

use pio::{Program, pio_asm};

/// From one pulse to the next, beside the number in the queue and [`hold_of`]: `out`, the last
/// turn of `wait`, `set`, `mov`, the last turn of `hold`, `set`.
pub const PULSE_OVERHEAD_CYCLES: u32 = 6;
/// From the queue to the pulse, beside the number: the write, the pull, `out`, the last
/// turn of `wait`, `set`.
pub const PULSE_LEAD_CYCLES: u32 = 2 + 1 + 1 + 1 + 1;

/// What Y holds for a pulse of so many cycles: `mov`, the last turn of `hold` and `set` take three.
#[must_use]
pub const fn hold_of(width_cycles: u32) -> u32 {
    width_cycles.saturating_sub(3)
}

/// The stamping machines: addresses, and what their time loses.
pub mod stamp {
    /// Looks for a rise.
    pub const LOW: u8 = 7;
    /// Looks for a fall.
    pub const HIGH: u8 = 24;
    /// Of the twelve cycles of an edge one is counted, six would be right.
    pub const LOST_AT_EDGE: u32 = 5;
    /// Of the two cycles of a fall that is not stamped none is counted.
    pub const LOST_AT_FALL: u32 = 1;
    // A jump's address has five bits.
    const _: () = assert!(LOW == !HIGH & 31);
}

/// Entries and ends of the programs, as addresses in the memory of their PIO.
pub struct Programs<const N: usize> {
    /// The instructions, from address 0.
    pub code: Program<32>,
    /// Per machine: where it starts, where it goes after its last, and its last.
    pub machines: [Place; N],
}

/// Where the program of a machine is.
#[derive(Clone, Copy)]
pub struct Place {
    /// The first instruction.
    pub entry: u8,
    /// The instruction after the last.
    pub wrap_target: u8,
    /// The last instruction.
    pub wrap_source: u8,
}

/// PIO 0: one program for all.
pub fn quadrature() -> Programs<1> {
    let assembled = pio_asm!(
        ".origin 0",
        // before 00, now 00 01 10 11: pins are B A, up is 00 01 11 10
        "jmp update [3]",
        "jmp up",
        "jmp down [2]",
        "jmp x-- update [3]",
        // before 01
        "jmp down [2]",
        "jmp update [3]",
        "jmp x-- update [3]",
        "jmp up",
        // before 10
        "jmp up",
        "jmp x-- update [3]",
        "jmp update [3]",
        "jmp down [2]",
        // before 11
        "jmp x-- update [3]",
        "jmp down [2]",
        "jmp up",
        "jmp update [3]",
        "down:",
        "jmp y-- update",
        ".wrap_target",
        "public update:",
        "in x, 14",
        "in y, 18",
        "out isr, 2",
        "in pins, 2",
        "mov osr, isr",
        "mov pc, isr",
        "up:",
        "mov y, ~y",
        "jmp y-- again",
        "again:",
        "mov y, ~y",
        ".wrap",
    );
    let place = Place {
        entry: assembled.public_defines.update as u8,
        wrap_target: assembled.program.wrap.target,
        wrap_source: assembled.program.wrap.source,
    };
    Programs {
        code: assembled.program,
        machines: [place],
    }
}

/// PIO 1: stamps of skip and trigger, events, pulses. All 32 places are taken.
pub fn captures() -> Programs<4> {
    let assembled = pio_asm!(
        ".origin 0",
        "public pulse:",
        "out x, 32",
        "delay:",
        "jmp x-- delay",
        "set pins, 1",
        "mov x, y",
        "hold:",
        "jmp x-- hold",
        "public pulse_end:",
        "set pins, 0",
        // 6
        "public fell:",
        "mov osr, ~osr",
        "public low:",
        "jmp pin edge",
        "public below:",
        "jmp x-- low",
        // Only of triggers, when X was zero.
        "jmp pin edge",
        "jmp x-- low",
        // 11
        "public events:",
        "in pins, 5",
        "mov osr, x",
        "mov x, isr",
        "jmp x!=y changed",
        "mov isr, null",
        "jmp count [2]",
        "changed:",
        "in y, 5",
        "mov y, x",
        "in osr, 22",
        "push noblock",
        "count:",
        "mov x, osr",
        "public events_end:",
        "jmp x-- events",
        // 23
        "high:",
        "jmp x-- watch",
        "public watch:",
        "jmp pin high",
        "edge:",
        "in y, 13",
        "in x, 19",
        "push noblock",
        "jmp y-- counted",
        "counted:",
        "mov osr, ~osr [4]",
        "jmp x-- back",
        "back:",
        "mov pc, osr",
    );
    let labels = assembled.public_defines;
    debug_assert!(labels.low as u8 == stamp::LOW && labels.watch as u8 == stamp::HIGH);
    let skip = Place {
        entry: labels.low as u8,
        wrap_target: labels.low as u8,
        wrap_source: labels.below as u8,
    };
    let trigger = Place {
        entry: labels.low as u8,
        wrap_target: labels.fell as u8,
        wrap_source: labels.watch as u8,
    };
    let events = Place {
        entry: labels.events_end as u8,
        wrap_target: labels.events as u8,
        wrap_source: labels.events_end as u8,
    };
    let pulse = Place {
        entry: labels.pulse as u8,
        wrap_target: labels.pulse as u8,
        wrap_source: labels.pulse_end as u8,
    };
    Programs {
        code: assembled.program,
        machines: [skip, trigger, events, pulse],
    }
}

/// Instructions that set up a machine before it is started.
pub mod setup {
    use pio::{
        InSource, InstructionOperands, JmpCondition, MovDestination, MovOperation, MovSource,
        SetDestination,
    };

    const fn encoded(operands: InstructionOperands) -> u16 {
        // Neither delay nor side-set: the operands are the whole instruction.
        operands.encode()
    }

    const fn mov(destination: MovDestination, op: MovOperation, source: MovSource) -> u16 {
        encoded(InstructionOperands::MOV {
            destination,
            op,
            source,
        })
    }

    /// `mov x, ~null`
    pub const X_ALL_ONES: u16 = mov(MovDestination::X, MovOperation::Invert, MovSource::NULL);
    /// `mov x, null`
    pub const X_ZERO: u16 = mov(MovDestination::X, MovOperation::None, MovSource::NULL);
    /// `mov y, ~null`
    pub const Y_ALL_ONES: u16 = mov(MovDestination::Y, MovOperation::Invert, MovSource::NULL);
    /// `mov y, null`
    pub const Y_ZERO: u16 = mov(MovDestination::Y, MovOperation::None, MovSource::NULL);
    /// `mov isr, ~y`
    pub const ISR_NOT_Y: u16 = mov(MovDestination::ISR, MovOperation::Invert, MovSource::Y);
    /// `mov osr, y`
    pub const OSR_Y: u16 = mov(MovDestination::OSR, MovOperation::None, MovSource::Y);
    /// `mov y, isr`
    pub const Y_ISR: u16 = mov(MovDestination::Y, MovOperation::None, MovSource::ISR);
    /// `in y, 5`
    pub const IN_Y: u16 = encoded(InstructionOperands::IN {
        source: InSource::Y,
        bit_count: 5,
    });
    /// `push noblock`
    pub const PUSH: u16 = encoded(InstructionOperands::PUSH {
        if_full: false,
        block: false,
    });
    /// `mov osr, pins`: the two lowest bits are the pins of the axis.
    pub const OSR_PINS: u16 = mov(MovDestination::OSR, MovOperation::None, MovSource::PINS);
    /// `set pins, 0`
    pub const PIN_LOW: u16 = encoded(InstructionOperands::SET {
        destination: SetDestination::PINS,
        data: 0,
    });
    /// `set pindirs, 1`
    pub const PIN_OUT: u16 = encoded(InstructionOperands::SET {
        destination: SetDestination::PINDIRS,
        data: 1,
    });

    /// `set y, value`
    pub const fn y(value: u8) -> u16 {
        // The value has the five lowest bits: no encoder at run time, which can panic.
        const Y_0: u16 = encoded(InstructionOperands::SET {
            destination: SetDestination::Y,
            data: 0,
        });
        Y_0 | (value & 31) as u16
    }

    /// `jmp address`
    pub const fn jump(address: u8) -> u16 {
        const TO_0: u16 = encoded(InstructionOperands::JMP {
            condition: JmpCondition::Always,
            address: 0,
        });
        TO_0 | (address & 31) as u16
    }

    const _: () = {
        let y_21 = encoded(InstructionOperands::SET {
            destination: SetDestination::Y,
            data: 21,
        });
        let to_21 = encoded(InstructionOperands::JMP {
            condition: JmpCondition::Always,
            address: 21,
        });
        assert!(y(21) == y_21 && jump(21) == to_21);
    };
}
