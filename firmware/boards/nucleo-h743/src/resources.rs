//! Resource plan: the use of each pin, timer and clock. Numbers only: `build.rs` reads this
//! file too.
//!
//! Alternate functions are those of DS12110 (STM32H743xI), tables 9 to 19. They were
//! not typed off it: each is held, when this is built, against the table that ST
//! publishes for its tools (as `stm32-metapac` carries it).

/// A pin in an alternate function.
#[derive(Clone, Copy, Debug)]
pub struct Signal {
    /// Port and number.
    pub pin: (char, u8),
    /// Whose signal.
    pub peripheral: &'static str,
    /// Which.
    pub signal: &'static str,
    /// The number of the alternate function.
    pub function: u8,
}

const fn signal(
    pin: (char, u8),
    peripheral: &'static str,
    signal: &'static str,
    function: u8,
) -> Signal {
    Signal {
        pin,
        peripheral,
        signal,
        function,
    }
}

/// Axes.
pub const AXES: usize = 5;
/// Timers that are captured by one edge: the axes' and the clock's.
pub const TIMERS: usize = AXES + 1;

/// A and B of each axis: TIM1, 3, 4, 8 and 2.
pub const ENCODERS: [Signal; 2 * AXES] = [
    signal(('E', 9), "TIM1", "CH1", 1),
    signal(('E', 11), "TIM1", "CH2", 1),
    signal(('B', 4), "TIM3", "CH1", 2),
    signal(('B', 5), "TIM3", "CH2", 2),
    signal(('D', 12), "TIM4", "CH1", 2),
    signal(('D', 13), "TIM4", "CH2", 2),
    signal(('C', 6), "TIM8", "CH1", 3),
    signal(('C', 7), "TIM8", "CH2", 3),
    signal(('A', 15), "TIM2", "CH1", 1),
    signal(('B', 3), "TIM2", "CH2", 1),
];

/// The skip line, on channel 3 of every axis and of the clock, TIM5.
pub const SKIP: [Signal; TIMERS] = [
    signal(('E', 13), "TIM1", "CH3", 1),
    signal(('B', 0), "TIM3", "CH3", 2),
    signal(('D', 14), "TIM4", "CH3", 2),
    signal(('C', 8), "TIM8", "CH3", 3),
    signal(('B', 10), "TIM2", "CH3", 1),
    signal(('A', 2), "TIM5", "CH3", 2),
];

/// The trigger line, on channel 4 of the same.
pub const TRIGGER: [Signal; TIMERS] = [
    signal(('E', 14), "TIM1", "CH4", 1),
    signal(('B', 1), "TIM3", "CH4", 2),
    signal(('D', 15), "TIM4", "CH4", 2),
    signal(('C', 9), "TIM8", "CH4", 3),
    signal(('B', 11), "TIM2", "CH4", 1),
    signal(('A', 3), "TIM5", "CH4", 2),
];

/// RS-232 to the control. RTS, beside them, is a plain pin: the port would take it away while a byte waits.
pub const CONTROL: [Signal; 3] = [
    signal(('D', 5), "USART2", "TX", 7),
    signal(('D', 6), "USART2", "RX", 7),
    signal(('D', 3), "USART2", "CTS", 7),
];

/// RS-232 or RS-422 from a distance sensor.
pub const SENSOR: [Signal; 1] = [signal(('G', 9), "USART6", "RX", 7)];

/// Trigger pulses to a distance sensor.
pub const PULSES: [Signal; 1] = [signal(('B', 8), "TIM16", "CH1", 1)];

/// The journal's flash, without its select line.
pub const FLASH: [Signal; 3] = [
    signal(('E', 2), "SPI4", "SCK", 5),
    signal(('E', 5), "SPI4", "MISO", 5),
    signal(('E', 6), "SPI4", "MOSI", 5),
];

/// USB to the host.
pub const USB: [Signal; 2] = [
    signal(('A', 11), "USB_OTG_FS", "DM", 10),
    signal(('A', 12), "USB_OTG_FS", "DP", 10),
];

/// Plain pins: select line of the flash, OK, NG, busy, laser, the red LED LD3, the blue button B1, and
/// what a distance sensor tells the control: skip, parity, is OK, has no signal; VBUS of the USB
/// connector, at which the controller looks without an alternate function; RTS to the control; and the
/// owner's jumper.
pub const PLAIN: [(char, u8); 14] = [
    ('D', 4),
    ('E', 4),
    ('F', 13),
    ('F', 14),
    ('F', 15),
    ('G', 0),
    ('B', 14),
    ('C', 13),
    ('F', 12),
    ('G', 1),
    ('G', 2),
    ('G', 3),
    ('A', 9),
    ('F', 8),
];

/// Pins of the plan on which the Nucleo-144 has something of its own that can be cut off by a
/// solder bridge, and what (README.md, "Wiring").
pub const BRIDGED: [((char, u8), &str); 2] = [
    (('A', 2), "the Ethernet PHY's MDIO"),
    (('B', 0), "the green LED LD1"),
];

/// They are pins of the plan: else the note is out of date.
const _: () = {
    let mut index = 0;
    while index < BRIDGED.len() {
        let (pin, _) = BRIDGED[index];
        let mut at = 0;
        while SIGNALS[at].pin.0 as u32 != pin.0 as u32 || SIGNALS[at].pin.1 != pin.1 {
            // Past the end it does not compile.
            at += 1;
        }
        index += 1;
    }
};

/// What the Nucleo-144 has on pins that it does not let go of: the debugger's two, its
/// crystal or its debugger's clock, and the slow crystal (UM1974, UM2407). Not checked
/// against the boards' schematics.
pub const TAKEN: [(char, u8); 6] = [
    ('A', 13),
    ('A', 14),
    ('H', 0),
    ('H', 1),
    ('C', 14),
    ('C', 15),
];

const COUNT: usize = ENCODERS.len()
    + SKIP.len()
    + TRIGGER.len()
    + CONTROL.len()
    + SENSOR.len()
    + PULSES.len()
    + FLASH.len()
    + USB.len();

/// All pins in alternate functions.
pub const SIGNALS: [Signal; COUNT] = {
    let groups: [&[Signal]; 8] = [
        &ENCODERS, &SKIP, &TRIGGER, &CONTROL, &SENSOR, &PULSES, &FLASH, &USB,
    ];
    let mut all = [ENCODERS[0]; COUNT];
    let mut next = 0;
    let mut group = 0;
    while group < groups.len() {
        let mut index = 0;
        while index < groups[group].len() {
            all[next] = groups[group][index];
            next += 1;
            index += 1;
        }
        group += 1;
    }
    all
};

/// No pin has two uses.
const _: () = {
    let mut pins = [('-', 0); COUNT + PLAIN.len() + TAKEN.len()];
    let mut at = 0;
    while at < pins.len() {
        pins[at] = if at < COUNT {
            SIGNALS[at].pin
        } else if at < COUNT + PLAIN.len() {
            PLAIN[at - COUNT]
        } else {
            TAKEN[at - COUNT - PLAIN.len()]
        };
        let mut before = 0;
        while before < at {
            let same = pins[before].0 as u32 == pins[at].0 as u32 && pins[before].1 == pins[at].1;
            assert!(!same, "a pin has two uses");
            before += 1;
        }
        at += 1;
    }
};

/// The clock that the debugger's processor gives to the chip.
pub const HSE_HZ: u32 = 8_000_000;
/// PLL1: what divides its input, multiplies it, and divides its output P.
pub const PLL: [u32; 3] = [1, 100, 2];
/// What divides the core's clock for the buses, and that for the peripherals.
pub const BUS_DIVIDERS: [u32; 2] = [2, 2];

const VCO_HZ: u32 = HSE_HZ / PLL[0] * PLL[1];
/// The core.
pub const CORE_HZ: u32 = VCO_HZ / PLL[2];
/// The buses.
pub const BUS_HZ: u32 = CORE_HZ / BUS_DIVIDERS[0];
/// The peripherals on APB1, 2 and 4.
pub const PERIPHERAL_HZ: u32 = BUS_HZ / BUS_DIVIDERS[1];
/// All timers: twice the clock of their bus, as it is divided by more than 1 (RM0433,
/// 8.5.5). One period is the resolution of a latch.
pub const TIMER_HZ: u32 = 2 * PERIPHERAL_HZ;

// The limits at VOS1 (DS12110, 6.3.1 and 6.3.11): every revision of the chip keeps them;
// 480 MHz would need revision V.
const _: () = {
    let reference = HSE_HZ / PLL[0];
    assert!(reference >= 2_000_000 && reference <= 16_000_000);
    assert!(VCO_HZ >= 192_000_000 && VCO_HZ <= 836_000_000);
    assert!(CORE_HZ <= 400_000_000);
    assert!(BUS_HZ <= 200_000_000);
    assert!(PERIPHERAL_HZ <= 100_000_000);
};

/// Samples that must agree before an input changes, one each timer clock: 20 ns. The
/// same for encoders, skip and trigger, so that the delays of position and edge cancel.
pub const FILTER_SAMPLES: u32 = 4;
/// The highest rate that the plan is made for.
pub const COUNTS_PER_S: u32 = 20_000_000;
/// How often the counters are looked at.
pub const LOOK_US: u64 = 500;

// An edge of an encoder is longer than the filter, its synchroniser and the decoder need.
const _: () = assert!(TIMER_HZ / COUNTS_PER_S >= FILTER_SAMPLES + 2);

/// What the clock of a slow line is divided by first: the divider behind it has 16 bits.
pub const SLOW_PRESCALER: u32 = 16;

/// Whether a line of this speed needs that.
pub const fn is_slow(baud: u32) -> bool {
    baud < 2400
}

/// What the peripheral's clock is divided by for a line of this speed.
pub const fn baud_divider(baud: u32) -> u32 {
    let baud = if baud == 0 { 1 } else { baud };
    let clock = match is_slow(baud) {
        true => PERIPHERAL_HZ / SLOW_PRESCALER,
        false => PERIPHERAL_HZ,
    };
    (clock + baud / 2) / baud
}

// Within 0.5 % of what it should be: two ends may differ by 2 %.
const _: () = {
    let mut number = 0;
    while number < LINES.len() {
        let baud = LINES[number];
        let divider = baud_divider(baud);
        assert!(divider >= 16 && divider < 1 << 16);
        let clock = match is_slow(baud) {
            true => PERIPHERAL_HZ / SLOW_PRESCALER,
            false => PERIPHERAL_HZ,
        };
        assert!(baud.abs_diff(clock / divider) * 200 <= baud);
        number += 1;
    }
};

/// Speeds that controls and sensors have. A sensor's 3 000 000 is off by one percent.
const LINES: [u32; 14] = [
    300, 600, 1200, 2400, 4800, 9600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 921_600,
    2_000_000,
];

/// The shortest interval of a distance sensor's pulses, microseconds: 10 kHz, what captures can be
/// told of.
pub const LEAST_INTERVAL_US: u32 = 100;
/// The longest: the timer of the pulses has 16 bits.
pub const MOST_INTERVAL_US: u32 = 1 << 16;

/// Of the flash's bus: `03h` reads up to 33 MHz with every chip that is known.
pub const FLASH_HZ: u32 = 25_000_000;

/// Unless it is fed so often, the watchdog resets the board: longer than erasing a
/// sector may take until it is given up (4 s), and a feed after that.
pub const WATCHDOG_US: u32 = 6_000_000;

/// MPU_RASR (PM0253, 4.6.6) of one region over all addresses, without those of its eight parts that
/// the image uses: code, RAM, peripherals, and the core's own. From 0x6000_0000 to 0xDFFF_FFFF are
/// external memories that this board has not, and the core may read ahead where memory is normal
/// (AN4838, speculative accesses): there is no access, and none is tried.
pub const MPU_NOTHING_THERE: u32 = {
    const ENABLE: u32 = 1;
    const ALL: u32 = 31 << 1;
    const NOT_THESE: u32 = 0b1000_0111 << 8;
    const NEVER_EXECUTED: u32 = 1 << 28;
    // No access: AP = 0. Strongly ordered, so not read ahead: TEX, C, B = 0.
    ENABLE | ALL | NOT_THESE | NEVER_EXECUTED
};

/// Whether the region has this address.
const fn has_no_access(address: u32) -> bool {
    let part = address >> 29;
    MPU_NOTHING_THERE >> (8 + part) & 1 == 0
}

// What is used stays, to both ends of each: flash, DTCM, AXI SRAM, peripherals, the core's own.
const _: () = {
    let used = [
        0x0800_0000,
        0x081F_FFFF,
        0x2000_0000,
        0x2001_FFFF,
        0x2400_0000,
        0x2407_FFFF,
        0x4000_0000,
        0x5FFF_FFFF,
        0xE000_0000,
        0xFFFF_FFFF,
    ];
    let mut at = 0;
    while at < used.len() {
        assert!(!has_no_access(used[at]));
        at += 1;
    }
    // FMC, QUADSPI, FMC's SDRAM.
    assert!(has_no_access(0x6000_0000) && has_no_access(0x9000_0000));
    assert!(has_no_access(0xC000_0000) && has_no_access(0xDFFF_FFFF));
};
