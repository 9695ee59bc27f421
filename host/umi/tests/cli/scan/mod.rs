//! `umi scan`.

mod clouds;
mod demo;
mod digitize;
mod drive;
mod localise;
mod point_sensor;
mod profiles;
mod record;
mod report;
