//! `umi scan`.

mod clouds;
mod demo;
mod digitize;
mod localise;
mod point_sensor;
mod profiles;
mod record;
mod report;
