//! A distance sensor's port: its line, its trigger pulses, and what the control hears of it.
//!
//! # Design
//!
//! Pulses in time come from a timer that no interrupt touches. Every capture of the axes is taken by
//! skip and trigger, so a pulse itself is not captured: the sensor's own output (its exposure, sync) is, at
//! the trigger line. The pulse is at the end of the timer's interval, where it stops at rest.
//!
//! # Limitations
//!
//! No pulses where an axis crosses lines: no timer compares positions here.

use embassy_stm32::gpio::{AfType, Output, OutputType, Pull, Speed};
use embassy_stm32::pac::timer::vals::OcmLimited;
use embassy_stm32::pac::{TIM16, USART6};
use embassy_stm32::{interrupt, peripherals, rcc};
use embassy_time::{Duration, Timer};
use umi_app::board::{Axes, CncInput, SensorLines, SensorPort, SensorTrigger};
use umi_core::trigger;
use umi_drivers::collector::Collector;
use umi_protocol::latch::{Positions, SignalLevel, TriggerOut, TriggerPulse, TriggerRefusal};
use umi_protocol::serial::LineSettings;

use super::control;
use crate::resources::{self, AXES, LEAST_INTERVAL_US, MOST_INTERVAL_US, TIMER_HZ};
use crate::{axes, timers};

/// Bytes that can wait: 11 ms at 921 600 baud.
const RING: usize = 1_024;
/// Of the port's FIFO.
const FIFO: usize = 16;

/// What has come in.
#[unsafe(link_section = ".dtcm")]
static LINE: Collector<RING> = Collector::new();

/// Starts the port; its line is set when a sensor is.
pub fn start() {
    rcc::enable_and_reset::<peripherals::USART6>();
    rcc::enable_and_reset::<peripherals::TIM16>();
    let [receive] = &resources::SENSOR;
    // A line that is not connected rests.
    timers::connect(receive, Pull::Up);
    set_line(LineSettings::DEFAULT);
    const PRESCALER: u32 = TIMER_HZ / 1_000_000;
    TIM16.psc().write_value((PRESCALER - 1) as u16);
    TIM16.ccmr_output(0).write(|w| {
        w.set_ocm(0, OcmLimited::PWM_MODE2);
        w.set_ocpe(0, true);
    });
    TIM16.ccr(0).write(|w| w.set_ccr(u16::MAX));
    TIM16.cr1().write(|w| w.set_arpe(true));
    TIM16.egr().write(|w| w.set_ug(true));
    TIM16.ccer().write(|w| w.set_cce(0, true));
    TIM16.bdtr().write(|w| w.set_moe(true));
    let [pulses] = &resources::PULSES;
    let output = AfType::output(OutputType::PushPull, Speed::Low);
    core::mem::forget(timers::flex(pulses, output));
}

fn set_line(line: LineSettings) {
    control::set_port(USART6, &line, true, false);
    LINE.set_line(&line);
}

#[interrupt]
fn USART6() {
    for _ in 0..FIFO {
        let Some((byte, lost)) = control::taken(USART6) else {
            return;
        };
        LINE.take(byte, lost);
    }
}

/// The sensor's port, and its outputs to the control.
pub struct SensorEnd {
    pub skip: Output<'static>,
    pub parity: Output<'static>,
    pub is_ok: Output<'static>,
    pub has_no_signal: Output<'static>,
}

impl Axes for SensorEnd {
    fn positions(&mut self) -> Positions {
        axes::positions()
    }
}

impl SensorPort for SensorEnd {
    async fn read(&mut self, buffer: &mut [u8]) -> CncInput {
        LINE.read(buffer, |us| Timer::after(Duration::from_micros(us)))
            .await
    }

    fn set_baud(&mut self, baud: u32) {
        set_line(LineSettings {
            baud,
            ..LineSettings::DEFAULT
        });
    }

    fn trigger(&mut self, when: SensorTrigger, pulse: TriggerPulse) -> Result<(), TriggerRefusal> {
        // None where this one is refused.
        stop();
        match when {
            SensorTrigger::Off => Ok(()),
            SensorTrigger::Every { interval_us } => {
                let when = TriggerOut::Time { interval_us, pulse };
                trigger::check(when, AXES, LEAST_INTERVAL_US, MOST_INTERVAL_US)?;
                begin(interval_us, pulse);
                Ok(())
            }
            SensorTrigger::Lines { .. } => Err(TriggerRefusal::NoOutput),
        }
    }

    fn show(&mut self, lines: SensorLines) {
        self.skip.set_level(lines.skip.into());
        self.is_ok.set_level(lines.is_ok.into());
        self.has_no_signal.set_level(lines.has_no_signal.into());
        // Last: it says that the others hold.
        self.parity.set_level(lines.parity.into());
    }
}

/// Begins with pulses; one that is still on is ended by the timer, and the new interval follows.
fn begin(interval_us: u32, pulse: TriggerPulse) {
    let last = interval_us.saturating_sub(1);
    let rest = interval_us.saturating_sub(pulse.width_us.into());
    TIM16
        .ccer()
        .modify(|w| w.set_ccp(0, pulse.rests == SignalLevel::High));
    TIM16.arr().write(|w| w.set_arr(last as u16));
    TIM16.ccr(0).write(|w| w.set_ccr(rest as u16));
    if !TIM16.cr1().read().cen() {
        // It stands: what is written counts at once, and from the beginning.
        TIM16.egr().write(|w| w.set_ug(true));
    }
    TIM16.cr1().modify(|w| {
        w.set_opm(false);
        w.set_cen(true);
    });
}

/// Ends the pulses. One that is on goes on to its end, where the timer stops by itself.
fn stop() {
    TIM16.cr1().modify(|w| w.set_cen(false));
    if TIM16.cnt().read().cnt() >= TIM16.ccr(0).read().ccr() {
        TIM16.cr1().modify(|w| {
            w.set_opm(true);
            w.set_cen(true);
        });
    }
}
