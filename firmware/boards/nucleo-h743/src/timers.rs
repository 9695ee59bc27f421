//! The registers of the timers that count and capture.
//!
//! Advanced, 32-bit and other timers have the registers that are used here at the same
//! places (RM0433, 38 and 39), so all are accessed as general-purpose ones, and all 32
//! bits are read: of a 16-bit counter the upper half is zero.

use embassy_stm32::gpio::{AfType, AnyPin, Flex, Pull};
use embassy_stm32::pac::gpio::vals::Idr;
use embassy_stm32::pac::timer::TimGp16;
use embassy_stm32::pac::timer::regs::{CntCore, SrGp16};
use embassy_stm32::pac::timer::vals::{CcmrInputCcs, FilterValue, Sms};
use embassy_stm32::{pac, peripherals, rcc};
use umi_core::capture::join_timers::Captures;

use crate::resources::{self, AXES, Signal, TIMERS};

/// The timers in the order of [`resources::SKIP`]: the axes', then the clock's.
const ALL: [TimGp16; TIMERS] = {
    // SAFETY: these are the addresses of the timers; see above.
    unsafe {
        [
            TimGp16::from_ptr(pac::TIM1.as_ptr()),
            TimGp16::from_ptr(pac::TIM3.as_ptr()),
            TimGp16::from_ptr(pac::TIM4.as_ptr()),
            TimGp16::from_ptr(pac::TIM8.as_ptr()),
            TimGp16::from_ptr(pac::TIM2.as_ptr()),
            CLOCK,
        ]
    }
};

// SAFETY: as above.
const CLOCK: TimGp16 = unsafe { TimGp16::from_ptr(pac::TIM5.as_ptr()) };

const FILTER: FilterValue = {
    assert!(resources::FILTER_SAMPLES == 4);
    FilterValue::FCK_INT_N4
};

/// What captures: a line on one channel of every timer.
#[derive(Clone, Copy)]
pub enum CaptureLine {
    /// Channel 3: rises and falls.
    Skip = 2,
    /// Channel 4: rises.
    Trigger = 3,
}

/// Starts counting and capturing, all timers from zero.
pub fn start() {
    rcc::enable_and_reset::<peripherals::TIM1>();
    rcc::enable_and_reset::<peripherals::TIM2>();
    rcc::enable_and_reset::<peripherals::TIM3>();
    rcc::enable_and_reset::<peripherals::TIM4>();
    rcc::enable_and_reset::<peripherals::TIM5>();
    rcc::enable_and_reset::<peripherals::TIM8>();
    for signal in &resources::ENCODERS {
        connect(signal, Pull::Up);
    }
    for signal in resources::SKIP.iter().chain(&resources::TRIGGER) {
        connect(signal, Pull::Down);
    }
    for (index, timer) in ALL.into_iter().enumerate() {
        // All four channels are inputs of their own pins, with the same filter.
        for half in 0..2 {
            timer.ccmr_input(half).write(|w| {
                for channel in 0..2 {
                    w.set_ccs(channel, CcmrInputCcs::TI4);
                    w.set_icf(channel, FILTER);
                }
            });
        }
        // Rising edges, and of the skip line falling ones too; the encoder mode looks at both by
        // itself.
        timer.ccer().write(|w| {
            for channel in 0..4 {
                w.set_cce(channel, true);
            }
            w.set_ccp(CaptureLine::Skip as usize, true);
            w.set_ccnp(CaptureLine::Skip as usize, true);
        });
        if index < AXES {
            timer.smcr().write(|w| w.set_sms(Sms::ENCODER_MODE_3));
        }
        timer.arr().write(|w| w.0 = u32::MAX);
    }
    // The clock's captures stand for all: one edge reaches every timer.
    pause(CaptureLine::Skip, false);
    pause(CaptureLine::Trigger, false);
    for timer in ALL {
        timer.cr1().modify(|w| w.set_cen(true));
    }
}

/// Gives a pin to its peripheral, for good.
pub fn connect(signal: &Signal, pull: Pull) {
    core::mem::forget(flex(signal, AfType::input(pull)));
}

/// A pin in its alternate function.
pub fn flex(signal: &Signal, kind: AfType) -> Flex<'static> {
    let (port, number) = signal.pin;
    let port = port as u8 - b'A';
    // SAFETY: the plan gives no pin twice, which is checked when it is compiled.
    let pin = unsafe { AnyPin::steal(port * 16 + number) };
    let mut flex = Flex::new(pin);
    flex.set_as_af_unchecked(signal.function, kind);
    flex
}

/// Where the axes' counters are, one read after the other.
pub fn counts() -> [u32; AXES] {
    let [x, y, z, a, b, _] = ALL.map(count);
    [x, y, z, a, b]
}

/// Where the clock is.
pub fn clock() -> u32 {
    count(CLOCK)
}

fn count(timer: TimGp16) -> u32 {
    let CntCore(count) = timer.cnt().read();
    count
}

/// Lets a line interrupt, or not. It captures in any case.
pub fn pause(line: CaptureLine, paused: bool) {
    CLOCK.dier().modify(|w| w.set_ccie(line as usize, !paused));
}

/// The level of the skip line (high: true) that its latest captured edge has left. None: another
/// edge waits, or comes just now.
///
/// The captures are looked at between two looks at the pin. That takes longer than their filter
/// and synchroniser do: six reads across the slow bus, each of several of its cycles, beside seven
/// cycles of a timer that is twice as fast. So an edge that the first look has seen is captured.
pub fn skip_level() -> Option<bool> {
    let mut line = CaptureLine::Skip;
    let before = skip_pin();
    let captured = (0..TIMERS).fold(false, |any, timer| any | line.is_captured(timer));
    (!captured && before == skip_pin()).then_some(before)
}

/// The pin of the clock's capture.
fn skip_pin() -> bool {
    pac::GPIOA.idr().read().idr(SKIP_PIN) == Idr::HIGH
}

const SKIP_PIN: usize = {
    let [.., clock] = &resources::SKIP;
    assert!(clock.pin.0 as u32 == 'A' as u32);
    clock.pin.1 as usize
};

impl Captures<TIMERS> for CaptureLine {
    fn is_captured(&mut self, timer: usize) -> bool {
        let channel = *self as usize;
        ALL.get(timer)
            .is_some_and(|timer| timer.sr().read().ccif(channel))
    }

    fn value(&mut self, timer: usize) -> u32 {
        let channel = *self as usize;
        // Reading the register clears the flag (RM0433, TIMx_SR, CC1IF).
        ALL.get(timer)
            .map_or(0, |timer| timer.ccr(channel).read().0)
    }

    fn take_overcapture(&mut self, timer: usize) -> bool {
        let channel = *self as usize;
        let Some(timer) = ALL.get(timer) else {
            return false;
        };
        let over = timer.sr().read().ccof(channel);
        if over {
            // Flags are cleared by zeros; ones leave the others as they are.
            let mut clear = SrGp16(u32::MAX);
            clear.set_ccof(channel, false);
            timer.sr().write_value(clear);
        }
        over
    }
}

/// Starts the interrupt of TIM7, each [`resources::LOOK_US`].
pub fn start_looking() {
    rcc::enable_and_reset::<peripherals::TIM7>();
    let timer = pac::TIM7;
    const PRESCALER: u32 = resources::TIMER_HZ / 1_000_000;
    timer.psc().write_value((PRESCALER - 1) as u16);
    timer
        .arr()
        .write(|w| w.set_arr(resources::LOOK_US as u16 - 1));
    timer.dier().write(|w| w.set_uie(true));
    timer.cr1().write(|w| w.set_cen(true));
}

/// The interrupt of [`start_looking`] is taken care of.
pub fn looked() {
    pac::TIM7.sr().write(|w| w.set_uif(false));
}
