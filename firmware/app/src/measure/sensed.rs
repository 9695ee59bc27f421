//! What of a distance sensor's station is kept and journaled.

use umi_core::journal::Flash;
use umi_core::point::station::check_sensor;
use umi_core::units::Micros;
use umi_protocol::message::{Record, Response};
use umi_protocol::point_sensor::{CaptureLoss, SensorLoss, SensorOnBoard, SensorRefusal};

use crate::measure::settings::{JobStore, NotKept};
use crate::measure::{Instrument, Ledger};
use crate::sensor::{PointStation, Told};

impl<F: Flash> Ledger<F> {
    /// Keeps the sensor in force once more, before a job is kept.
    pub(crate) fn keep_sensor_in(
        &mut self,
        settings: &mut JobStore<F>,
        now: Micros,
    ) -> Result<(), NotKept> {
        match self.point.and_then(PointStation::sensor) {
            Some(sensor) => settings.save_sensor(now, Some(&sensor), &mut self.scratch),
            None => Ok(()),
        }
    }
}

impl<F: Flash> Instrument<F> {
    /// Sets a sensor up, or takes it away: it is kept first.
    #[inline(never)]
    pub(crate) fn set_sensor(&mut self, now: Micros, sensor: Option<&SensorOnBoard>) -> Response {
        let Some(station) = self.ledger.point else {
            return Response::NotOnThisBoard;
        };
        if let Some(Err(refusal)) = sensor.map(check_sensor) {
            return Response::SensorRefused(refusal);
        }
        if station.status().waits {
            return Response::SensorRefused(SensorRefusal::UnderWay);
        }
        if !self.ledger.changes.take(now) {
            return Response::SensorRefused(SensorRefusal::UnderWay);
        }
        if self.keep_sensor(now, sensor).is_err() {
            return Response::StorageFailed;
        }
        station.set(sensor.copied());
        let (sensor, key_id) = (sensor.copied(), self.ledger.by.get().copied());
        match self
            .ledger
            .record(now, Record::SensorSet { sensor, key_id })
        {
            true => Response::Done,
            false => Response::StorageFailed,
        }
    }

    /// Keeps the sensor, and behind it the job: the ring of the settings drops neither for the
    /// other.
    fn keep_sensor(&mut self, now: Micros, sensor: Option<&SensorOnBoard>) -> Result<(), NotKept> {
        let Self {
            settings, ledger, ..
        } = self;
        let settings = settings.get_mut().ok_or(NotKept)?;
        settings.save_sensor(now, sensor, &mut ledger.scratch)?;
        self.keep_job(now)
    }

    /// Takes up the sensor that was in force, or tells why there is none any more.
    #[inline(never)]
    pub(crate) fn restore_sensor(&mut self, now: Micros) {
        let (Some(station), Some(settings)) = (self.ledger.point, self.settings.get_mut()) else {
            // Without settings there is no job either, and that is told.
            return;
        };
        let kept = settings.load_sensor(&mut self.ledger.scratch);
        let kept = kept.and_then(|kept| match kept.map(|sensor| check_sensor(&sensor)) {
            Some(Err(_)) => Err(SensorLoss::Refused),
            _ => Ok(kept),
        });
        let record = match kept {
            Ok(None) => return,
            Ok(sensor) => {
                station.set(sensor);
                Record::SensorSet {
                    sensor,
                    key_id: None,
                }
            }
            Err(why) => {
                station.lost(why);
                Record::CaptureLost(CaptureLoss::Setup(why))
            }
        };
        self.ledger.record(now, record);
    }

    /// Journals what the station has told.
    #[inline(never)]
    pub(crate) fn sensed(&mut self, now: Micros, station: &PointStation) {
        while let Some(told) = station.take_told() {
            let (at, record) = match told {
                Told::Record(at, record) => match record.report() {
                    Ok(place) => (at, Record::Place(place)),
                    Err(loss) => (at, Record::CaptureLost(loss)),
                },
                Told::Dropped(count) => (now, Record::CaptureLost(CaptureLoss::Records { count })),
                Told::Characters(count) => {
                    (now, Record::CaptureLost(CaptureLoss::Characters { count }))
                }
            };
            self.ledger.record(at, record);
        }
    }
}
