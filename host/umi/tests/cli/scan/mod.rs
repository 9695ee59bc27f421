//! `umi scan`.

mod axis;
mod calibrate;
mod clouds;
mod demo;
mod digitize;
mod drive;
mod foreign;
mod frames;
mod localise;
mod mount;
mod plan;
mod point_sensor;
mod profiles;
mod record;
mod report;
mod serve;
mod slips;
mod views;
