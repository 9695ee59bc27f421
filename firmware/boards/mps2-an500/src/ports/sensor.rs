//! The distance sensor's port. The bench plays its captures, as edges of the trigger input, when it
//! is told that the board triggers.

use umi_app::board::{Axes, CncInput, SensorLines, SensorPort, SensorTrigger};
use umi_protocol::latch::{Positions, TriggerPulse, TriggerRefusal};
use umi_stimuli::SensorTriggers;

use crate::SENSOR;
use crate::ports::bench;

/// The sensor's port: its UART, and the bench for all else.
pub struct SensorUart;

impl Axes for SensorUart {
    fn positions(&mut self) -> Positions {
        bench::Station.positions()
    }
}

impl SensorPort for SensorUart {
    async fn read(&mut self, buffer: &mut [u8]) -> CncInput {
        SENSOR.read(buffer).await
    }

    fn set_baud(&mut self, baud: u32) {
        SENSOR.set_baud(baud);
    }

    fn trigger(&mut self, when: SensorTrigger, _: TriggerPulse) -> Result<(), TriggerRefusal> {
        bench::note_triggers(match when {
            SensorTrigger::Off => SensorTriggers::Off,
            SensorTrigger::Every { interval_us } => SensorTriggers::Every { interval_us },
            SensorTrigger::Lines {
                axis,
                origin_counts,
                interval_counts,
            } => SensorTriggers::Lines {
                axis,
                origin_counts,
                interval_counts,
            },
        });
        Ok(())
    }

    fn show(&mut self, lines: SensorLines) {
        bench::note_sensor(lines);
    }
}
