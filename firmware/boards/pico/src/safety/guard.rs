//! Watchdog, and the cause of the last reset.
//!
//! The highest interrupt feeds the chip's watchdog, whose counter holds no more than eight
//! seconds; a fit may take longer where there is no floating-point unit. So each level of
//! priority has a patience of its own ([`umi_drivers::task_watchdog`]): the tasks of the lowest, which
//! wait for the measuring, [`MEASURING_S`]; the host's, above which nothing takes long,
//! [`HOST_S`], so that a task that spins there or above is seen as soon as the counter is over.

use embassy_rp::gpio::Output;
use embassy_rp::pac;
use embassy_rp::watchdog::{ResetReason as ByWatchdog, Watchdog};
use embassy_time::{Duration, Timer};
use umi_drivers::task_watchdog::TaskWatchdog;
use umi_protocol::message::ResetReason;

use crate::lights;
use crate::pins;
use crate::resources::{HOST_S, MEASURING_S, WATCHDOG_MS};
use crate::time::tick;

/// The lowest level: it answers when the measuring does.
static MEASURING: TaskWatchdog = TaskWatchdog::new(MEASURING_S * 1_000_000);
/// The level of the host's tasks.
static HOST: TaskWatchdog = TaskWatchdog::new(HOST_S * 1_000_000);

/// What the counter begins with: a fault of the RP2040 (E1) makes it count two each
/// microsecond.
#[cfg(not(feature = "rp2350"))]
const LOAD: u32 = 2000 * WATCHDOG_MS as u32;
#[cfg(feature = "rp2350")]
const LOAD: u32 = 1000 * WATCHDOG_MS as u32;
const _: () = assert!(LOAD < 1 << 24);

/// To be called each tick of the highest interrupt, with the low word of the
/// microseconds' timer.
pub fn ticked(now_us: u32) {
    if HOST.is_alive(now_us) && MEASURING.is_alive(now_us) {
        pac::WATCHDOG.load().write(|w| w.set_load(LOAD));
    }
}

/// Checks in, for ever: a task of the host's level.
pub async fn host_level() -> ! {
    loop {
        HOST.check_in(tick::now_us());
        Timer::after(Duration::from_secs(HOST_S.into()) / 4).await;
    }
}

const PATIENCE: Duration = Duration::from_millis(WATCHDOG_MS);

/// Why the board started, if it was not by a panic.
pub fn reset_reason(watchdog: &Watchdog) -> ResetReason {
    match watchdog.reset_reason() {
        Some(ByWatchdog::TimedOut) => ResetReason::Watchdog,
        Some(ByWatchdog::Forced) => ResetReason::Software,
        None => by_the_chip(),
    }
}

#[cfg(not(feature = "rp2350"))]
fn by_the_chip() -> ResetReason {
    let reset = pac::VREG_AND_CHIP_RESET.chip_reset().read();
    // The chip cannot tell a supply that was low from one that came on.
    match (reset.had_por(), reset.had_run()) {
        (true, _) => ResetReason::PowerOn,
        (false, true) => ResetReason::Pin,
        (false, false) => ResetReason::Unknown,
    }
}

#[cfg(feature = "rp2350")]
fn by_the_chip() -> ResetReason {
    let reset = pac::POWMAN.chip_reset().read();
    if reset.had_por() {
        ResetReason::PowerOn
    } else if reset.had_bor() {
        ResetReason::BrownOut
    } else if reset.had_run_low() {
        ResetReason::Pin
    } else {
        ResetReason::Unknown
    }
}

/// What the watchdog resets: all stages but the two oscillators, which are bits 0 and 1 of 17
/// on the RP2040 (data sheet 2.13.5), bits 2 and 3 of 25 on the RP2350 (7.4.4).
#[cfg(not(feature = "rp2350"))]
const STAGES: u32 = 0x0001_FFFC;
#[cfg(feature = "rp2350")]
const STAGES: u32 = 0x01FF_FFF3;

// By the names that the chip's maker gives the bits: the oscillators stay, everything else is reset.
const _: () = {
    let of = pac::psm::regs::Wdsel(STAGES);
    assert!(!of.rosc() && !of.xosc());
    assert!(of.clocks() && of.resets() && of.busfabric() && of.rom());
    assert!(of.sram0() && of.sram1() && of.sram2() && of.sram3() && of.sram4() && of.sram5());
    assert!(of.xip() && of.sio() && of.proc0() && of.proc1());
    #[cfg(not(feature = "rp2350"))]
    assert!(of.vreg_and_chip_reset() && STAGES >> 17 == 0);
    #[cfg(feature = "rp2350")]
    {
        assert!(of.proc_cold() && of.otp() && of.psm_ready() && of.bootram());
        assert!(of.sram6() && of.sram7() && of.sram8() && of.sram9());
        assert!(of.accessctrl() && STAGES >> 25 == 0);
    }
};

/// The HAL's driver selects the stages of an RP2040 on both chips.
fn select_stages() {
    pac::PSM.wdsel().write_value(pac::psm::regs::Wdsel(STAGES));
}

/// Laser and lamps go off, whatever else is broken: before anything that takes time.
pub fn dark() {
    pac::SIO.gpio_out(0).value_clr().write_value(pins::SWITCHED);
}

/// Resets everything but the oscillators, as the watchdog does, at once. Laser and lamps first.
pub fn reset_now() -> ! {
    cortex_m::interrupt::disable();
    dark();
    select_stages();
    pac::WATCHDOG.ctrl().write(|w| w.set_trigger(true));
    loop {
        cortex_m::asm::nop();
    }
}

/// The counter runs: when it is over everything is reset, and nothing that does not feed it holds it up.
pub fn watch(watchdog: &mut Watchdog) {
    watchdog.start(PATIENCE);
    select_stages();
}

/// The counter runs on: the boot ROM stops it where it is told that an image is confirmed.
#[cfg(feature = "slot-ab")]
pub fn watch_on() {
    pac::WATCHDOG.ctrl().modify(|w| w.set_enable(true));
}

/// The watchdog's second part, and the light that shows that it is fed.
pub struct Dog {
    light: Output<'static>,
    fed: u8,
}

impl Dog {
    /// Begins to watch.
    pub fn start(mut watchdog: Watchdog, light: Output<'static>) -> Self {
        watchdog.pause_on_debug(true);
        let now_us = tick::now_us();
        MEASURING.check_in(now_us);
        HOST.check_in(now_us);
        watch(&mut watchdog);
        Self { light, fed: 0 }
    }
}

impl umi_app::board::Watchdog for Dog {
    fn feed(&mut self) {
        MEASURING.check_in(tick::now_us());
        self.fed = self.fed.wrapping_add(1);
        // On with a short gap each two seconds: all is well. Blinking: it is not.
        let off = if lights::trouble() {
            self.fed.is_multiple_of(2)
        } else {
            self.fed.is_multiple_of(8)
        };
        self.light.set_level((!off).into());
    }
}
