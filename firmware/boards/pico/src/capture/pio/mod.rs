//! The eight state machines: set up, started in one cycle, watched for a stall.
//!
//! # Design
//!
//! All machines of a PIO start in the same cycle; the two PIOs start [`PIO_LAG_CYCLES`]
//! apart, by two store instructions that follow one another in memory which has no wait
//! states, with interrupts off, just after the microsecond timer has ticked. So the
//! instant of every sample is known from then on.
//!
//! Positions and errors live in the machines' registers. A restart leaves them alone, if the
//! machines stand still at a full FIFO.

pub mod programs;

use embassy_rp::pac;
use embassy_rp::pac::io::vals::{Inover, Outover};
use embassy_rp::pac::pio::Pio;
use embassy_rp::pac::pio::regs::{Fdebug, SmExecctrl, SmPinctrl, SmShiftctrl};
use umi_core::units::Cycles;
use umi_protocol::latch::SignalLevel;

use crate::pins::{AXES, AXIS_A, SKIP, TRIGGER_IN, TRIGGER_OUT, WATCHED};
use crate::resources::{
    CYCLES_PER_US, EVENTS_MACHINE, MOST_PULSE_CYCLES, PERIOD_CYCLES, PULSE_MACHINE, SKIP_MACHINE,
    TRIGGER_MACHINE,
};
use programs::{Place, hold_of, setup, stamp};

/// PIO 1 starts so many cycles after PIO 0: a store takes two on the Cortex-M0+. The
/// RP2350 starts both by one.
pub const PIO_LAG_CYCLES: u64 = if cfg!(feature = "rp2350") { 0 } else { 2 };
/// From the tick of the timer to the first cycle of PIO 0: half a turn of the loop
/// that waits for it, and the store. All instants may be off by half a turn more,
/// all alike.
const START_LAG_CYCLES: u64 = 10;
/// In the loop of an axis, the pins are read three cycles after its beginning; what is
/// pushed at the beginning of the first loop belongs to the sample before.
pub const FIRST_SAMPLE_CYCLES: u64 = PERIOD_CYCLES.get() as u64 - 3;

/// Two flip-flops make an input safe to read (RP2040 datasheet, 3.5.6.3): what a machine
/// reads was at the pin so many cycles before.
const SYNC_CYCLES: u64 = 2;

/// State machines of a PIO. Numbers of machines are taken modulo this, so that no interrupt has a
/// way to a panic.
const MACHINES: usize = 4;

/// Of a machine, in a register that has one for each.
const fn bit_of(machine: usize) -> u8 {
    1 << (machine % MACHINES)
}

/// When PIO 0 was started, in cycles of the clock.
#[derive(Clone, Copy)]
pub struct Started {
    /// When what it reads in its first cycle was at the pins.
    pub at: Cycles,
}

/// Loads the programs and gives the machines their pins. Positions begin at 0.
pub fn prepare() {
    let quadrature = programs::quadrature();
    load(pac::PIO0, &quadrature.code.code);
    for (axis, pin) in AXIS_A.into_iter().enumerate() {
        let [place] = quadrature.machines;
        let mut shift = SmShiftctrl(0);
        shift.set_autopush(true);
        shift.set_push_thresh(0);
        shift.set_out_shiftdir(true);
        shift.set_fjoin_rx(true);
        let mut pins = SmPinctrl(0);
        pins.set_in_base(pin);
        configure(pac::PIO0, axis, place, shift, pins, 0);
        for instruction in [setup::X_ALL_ONES, setup::Y_ZERO, setup::OSR_PINS] {
            execute(pac::PIO0, axis, instruction);
        }
    }

    let captures = programs::captures();
    load(pac::PIO1, &captures.code.code);
    for (machine, place) in captures.machines.into_iter().enumerate() {
        let mut shift = SmShiftctrl(0);
        shift.set_out_shiftdir(true);
        let mut pins = SmPinctrl(0);
        let mut jump_pin = 0;
        match machine {
            SKIP_MACHINE | TRIGGER_MACHINE => {
                shift.set_fjoin_rx(true);
                jump_pin = if machine == SKIP_MACHINE {
                    SKIP
                } else {
                    TRIGGER_IN
                };
            }
            EVENTS_MACHINE => {
                shift.set_fjoin_rx(true);
                pins.set_in_base(WATCHED);
            }
            _ => {
                shift.set_autopull(true);
                shift.set_pull_thresh(0);
                shift.set_fjoin_tx(true);
                pins.set_set_base(TRIGGER_OUT);
                pins.set_set_count(1);
            }
        }
        configure(pac::PIO1, machine, place, shift, pins, jump_pin);
    }
    execute(pac::PIO1, PULSE_MACHINE, setup::PIN_LOW);
    execute(pac::PIO1, PULSE_MACHINE, setup::PIN_OUT);
    listen(true, true);
}

/// From now on an interrupt for each stamp of a skip edge; of any other.
pub fn listen(skips: bool, scans: bool) {
    const _: () = assert!(SKIP_MACHINE == 0 && TRIGGER_MACHINE == 1 && EVENTS_MACHINE == 2);
    pac::PIO1.irqs(0).inte().write(|w| {
        w.set_sm0_rxnempty(skips);
        w.set_sm1_rxnempty(scans);
        w.set_sm2_rxnempty(scans);
    });
}

/// Edges that have come since this was last asked, at pins by GPIO number, one bit each: what their
/// own detectors know, which never stand still.
pub struct Edges {
    /// Pins that rose.
    pub rises: u32,
    /// Pins that fell.
    pub falls: u32,
}

/// The edges at these pins.
pub fn edges(pins: impl Iterator<Item = u8>) -> Edges {
    let mut found = Edges { rises: 0, falls: 0 };
    for pin in pins {
        // Eight pins a register.
        let register = pac::IO_BANK0.intr(usize::from(pin / 8) % 4);
        let pin_in_it = usize::from(pin % 8);
        let edges = register.read();
        register.write(|w| {
            w.set_edge_high(pin_in_it, edges.edge_high(pin_in_it));
            w.set_edge_low(pin_in_it, edges.edge_low(pin_in_it));
        });
        let bit = 1_u32.wrapping_shl(pin.into());
        found.rises |= if edges.edge_high(pin_in_it) { bit } else { 0 };
        found.falls |= if edges.edge_low(pin_in_it) { bit } else { 0 };
    }
    found
}

/// Stops all machines. What the decoders have counted is whole if they stand still at a
/// full FIFO.
pub fn halt() {
    pac::PIO0.ctrl().write(|w| w.set_sm_enable(0));
    pac::PIO1.ctrl().write(|w| w.set_sm_enable(0));
}

/// Edges that a machine has counted since it was started. It stands still, and its stamps
/// have been taken.
pub fn edges_counted(machine: usize) -> u32 {
    execute(pac::PIO1, machine, setup::ISR_NOT_Y);
    execute(pac::PIO1, machine, setup::PUSH);
    take_stamp(machine).unwrap_or_default()
}

/// Gets machines that stand still ready for a start; what the decoders have counted stays. Returns
/// the pins of skip and trigger that are high, one bit each: their machines wait for a fall first.
pub fn reset() -> u32 {
    // What is half shifted in is cleared.
    pac::PIO0.ctrl().write(|w| w.set_sm_restart(0xF));
    pac::PIO1.ctrl().write(|w| w.set_sm_restart(0xF));
    let quadrature = programs::quadrature();
    let captures = programs::captures();
    let [axes] = quadrature.machines;
    for axis in 0..AXES {
        clear(pac::PIO0, axis);
        execute(pac::PIO0, axis, setup::jump(axes.entry));
    }
    for (machine, place) in captures.machines.into_iter().enumerate() {
        clear(pac::PIO1, machine);
        execute(pac::PIO1, machine, setup::jump(place.entry));
    }
    stop_pulses();
    // An edge that comes between this look and the start is stamped at the start.
    let high = pac::SIO.gpio_in(0).read() & (1 << SKIP | 1 << TRIGGER_IN);
    for (machine, pin) in [(SKIP_MACHINE, SKIP), (TRIGGER_MACHINE, TRIGGER_IN)] {
        let entry = if high & 1_u32.wrapping_shl(pin.into()) == 0 {
            stamp::LOW
        } else {
            stamp::HIGH
        };
        for instruction in [
            setup::y(entry),
            setup::OSR_Y,
            setup::jump(entry),
            setup::X_ALL_ONES,
        ] {
            execute(pac::PIO1, machine, instruction);
        }
    }
    execute(pac::PIO1, EVENTS_MACHINE, setup::X_ZERO);
    for machine in [SKIP_MACHINE, TRIGGER_MACHINE, EVENTS_MACHINE] {
        execute(pac::PIO1, machine, setup::Y_ALL_ONES);
    }
    for pio in [pac::PIO0, pac::PIO1] {
        pio.fdebug().write_value(Fdebug(u32::MAX));
        pio.irq().write(|w| w.set_irq(0xFF));
    }
    high
}

/// Starts all machines. To be called with interrupts off.
pub fn start() -> Started {
    let tick = start_at_tick();
    Started {
        // Four thousand years fit in.
        at: Cycles(
            u64::from(CYCLES_PER_US)
                .wrapping_mul(tick)
                .wrapping_add(START_LAG_CYCLES - SYNC_CYCLES),
        ),
    }
}

/// Whether a sample of an axis was lost since the start: a machine that found no room
/// stood still.
#[inline(always)]
pub fn stalled() -> bool {
    pac::PIO0.fdebug().read().rxstall() != 0
}

/// Whether a stamp found no room since this was last asked.
pub fn stamps_dropped(machine: usize) -> bool {
    let bit = bit_of(machine);
    let dropped = pac::PIO1.fdebug().read().rxstall() & bit != 0;
    if dropped {
        pac::PIO1.fdebug().write(|w| w.set_rxstall(bit));
    }
    dropped
}

/// The oldest stamp that waits.
#[inline(always)]
pub fn take_stamp(machine: usize) -> Option<u32> {
    let empty = pac::PIO1.fstat().read().rxempty() & bit_of(machine) != 0;
    (!empty).then(|| pac::PIO1.rxf(machine % MACHINES).read())
}

/// Queues a pulse that comes `wait_cycles` and the program's own after the one before.
/// False: there is no room.
pub fn queue_pulse(wait_cycles: u32) -> bool {
    let full = pac::PIO1.fstat().read().txfull() & 1 << PULSE_MACHINE != 0;
    if !full {
        pac::PIO1.txf(PULSE_MACHINE).write_value(wait_cycles);
    }
    !full
}

/// Takes back every pulse that has not been sent; one that is on ends.
pub fn stop_pulses() {
    with_pulses_stopped(|| {});
}

/// Holds the machine that sends pulses, if none is on, or in any case. False: it goes on. To be
/// called with interrupts off.
pub fn hold_pulses(in_any_case: bool) -> bool {
    let is_on = || pac::PIO1.dbg_padout().read() & 1 << TRIGGER_OUT != 0;
    if is_on() && !in_any_case {
        return false;
    }
    let ctrl = pac::PIO1.ctrl();
    let running = ctrl.read().sm_enable();
    ctrl.write(|w| w.set_sm_enable(running & !bit_of(PULSE_MACHINE)));
    // One that has begun in between ends by itself, too: some cycles late, where held it would
    // last until the output is set, a tenth of a millisecond.
    let has_begun = is_on() && !in_any_case;
    if has_begun {
        release_pulses();
    }
    !has_begun
}

/// Lets it go on. To be called with interrupts off.
pub fn release_pulses() {
    let ctrl = pac::PIO1.ctrl();
    let running = ctrl.read().sm_enable();
    ctrl.write(|w| w.set_sm_enable(running | bit_of(PULSE_MACHINE)));
}

/// The level of the output between pulses. The machines see a pulse as high in either case: what
/// turns the output round turns its input back.
pub fn set_pulse_rest(rests: SignalLevel) {
    let (outside, inside) = match rests {
        SignalLevel::Low => (Outover::NORMAL, Inover::NORMAL),
        SignalLevel::High => (Outover::INVERT, Inover::INVERT),
    };
    let control = pac::IO_BANK0.gpio(TRIGGER_OUT.into()).ctrl();
    if control.read().outover() == outside {
        return;
    }
    // While the pin takes its time to change, its input says nothing of it: no pulse is captured.
    control.modify(|w| w.set_inover(Inover::LOW));
    control.modify(|w| w.set_outover(outside));
    cortex_m::asm::delay(CYCLES_PER_US);
    control.modify(|w| w.set_inover(inside));
}

/// Takes back every pulse that has not been sent; those that come are so many cycles long.
pub fn set_pulse_width(width_cycles: u32) {
    let hold = hold_of(width_cycles);
    with_pulses_stopped(|| {
        // By fives: an instruction carries no more. The restart has cleared what was shifted in.
        for place in (0..HOLD_FIVES).rev() {
            let five = (hold >> (5 * place)) as u8 & 31;
            execute(pac::PIO1, PULSE_MACHINE, setup::y(five));
            execute(pac::PIO1, PULSE_MACHINE, setup::IN_Y);
        }
        execute(pac::PIO1, PULSE_MACHINE, setup::Y_ISR);
    });
}

/// The longest pulse has 20 bits of cycles.
const HOLD_FIVES: u32 = 4;
const _: () = assert!(MOST_PULSE_CYCLES < 1 << (5 * HOLD_FIVES));

fn with_pulses_stopped(work: impl FnOnce()) {
    let bit = 1 << PULSE_MACHINE;
    let ctrl = pac::PIO1.ctrl();
    let running = ctrl.read().sm_enable();
    ctrl.write(|w| w.set_sm_enable(running & !bit));
    clear(pac::PIO1, PULSE_MACHINE);
    ctrl.write(|w| {
        w.set_sm_enable(running & !bit);
        w.set_sm_restart(bit);
    });
    execute(pac::PIO1, PULSE_MACHINE, setup::PIN_LOW);
    work();
    let [.., pulse] = programs::captures().machines;
    execute(pac::PIO1, PULSE_MACHINE, setup::jump(pulse.entry));
    ctrl.write(|w| w.set_sm_enable(running));
}

fn load(pio: Pio, code: &[u16]) {
    for (address, instruction) in code.iter().enumerate() {
        pio.instr_mem(address)
            .write(|w| w.set_instr_mem(*instruction));
    }
}

fn configure(
    pio: Pio,
    machine: usize,
    place: Place,
    shift: SmShiftctrl,
    pins: SmPinctrl,
    jump_pin: u8,
) {
    let registers = pio.sm(machine % MACHINES);
    registers.clkdiv().write(|w| w.set_int(1));
    let mut control = SmExecctrl(0);
    control.set_jmp_pin(jump_pin);
    control.set_wrap_bottom(place.wrap_target);
    control.set_wrap_top(place.wrap_source);
    registers.execctrl().write_value(control);
    registers.shiftctrl().write_value(shift);
    registers.pinctrl().write_value(pins);
}

fn execute(pio: Pio, machine: usize, instruction: u16) {
    pio.sm(machine % MACHINES)
        .instr()
        .write(|w| w.set_instr(instruction));
}

/// Empties the FIFOs: they are emptied when they are joined or parted.
fn clear(pio: Pio, machine: usize) {
    let shift = pio.sm(machine % MACHINES).shiftctrl();
    let as_it_is = shift.read();
    let mut otherwise = as_it_is;
    otherwise.set_fjoin_rx(!as_it_is.fjoin_rx());
    shift.write_value(otherwise);
    shift.write_value(as_it_is);
    #[cfg(not(feature = "rp2350"))]
    drain(pio, machine);
}

/// What is still there is taken out one by one.
#[cfg(not(feature = "rp2350"))]
fn drain(pio: Pio, machine: usize) {
    for _ in 0..8 {
        if pio.fstat().read().rxempty() & bit_of(machine) == 0 {
            pio.rxf(machine % MACHINES).read();
        }
    }
}

/// Waits for the next tick of the microsecond timer, starts, and returns the tick.
#[cfg(not(feature = "rp2350"))]
fn start_at_tick() -> u64 {
    use embassy_rp::pac::pio::regs::Ctrl;

    let mut control = Ctrl(0);
    control.set_sm_enable(0xF);
    control.set_clkdiv_restart(0xF);
    let low: u32;
    // SAFETY: reads a timer and writes two registers that exist; no memory is touched.
    // The function is in RAM, so that no wait state comes between the stores.
    unsafe {
        low = start_from_ram(
            pac::TIMER.timerawl().as_ptr(),
            pac::PIO0.ctrl().as_ptr().cast(),
            pac::PIO1.ctrl().as_ptr().cast(),
            control.0,
        );
    }
    extended(low, crate::time::clock::now_us())
}

#[cfg(feature = "rp2350")]
fn start_at_tick() -> u64 {
    let before = crate::time::clock::now_us();
    let mut now = before;
    while now == before {
        now = crate::time::clock::now_us();
    }
    pac::PIO0.ctrl().write(|w| {
        w.set_sm_enable(0xF);
        w.set_clkdiv_restart(0xF);
        w.set_next_pio_mask(0xF);
        w.set_nextprev_sm_enable(true);
        w.set_nextprev_clkdiv_restart(true);
    });
    now
}

/// The time whose low half was read a moment before `now`.
#[cfg(not(feature = "rp2350"))]
fn extended(low: u32, now: u64) -> u64 {
    now.wrapping_sub(u64::from((now as u32).wrapping_sub(low)))
}

/// Waits for the timer's tick and writes `control` to both registers.
///
/// # Safety
/// The pointers are the registers', and interrupts are off.
#[cfg(not(feature = "rp2350"))]
#[unsafe(link_section = ".data.start_from_ram")]
#[inline(never)]
unsafe fn start_from_ram(timer: *mut u32, pio0: *mut u32, pio1: *mut u32, control: u32) -> u32 {
    let ticked: u32;
    // SAFETY: the caller's registers, by loads and stores of their size.
    unsafe {
        core::arch::asm!(
            "ldr {before}, [{timer}]",
            "2:",
            "ldr {ticked}, [{timer}]",
            "cmp {ticked}, {before}",
            "beq 2b",
            "str {control}, [{pio0}]",
            "str {control}, [{pio1}]",
            timer = in(reg) timer,
            pio0 = in(reg) pio0,
            pio1 = in(reg) pio1,
            control = in(reg) control,
            before = out(reg) _,
            ticked = out(reg) ticked,
            options(nostack),
        );
    }
    ticked
}
