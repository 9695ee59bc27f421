//! Truth: what is measured is what is there, and what cannot be known is refused.
//!
//! Fits and registrations against answers of 50 digits, sessions with one thing wrong, the
//! second witness, the thesis' programs, the probing macros.

mod cases;
mod damage;
mod macros;
mod point_sensor;
mod reference_fits;
mod reference_registrations;
mod sessions;
mod thesis;
mod witness;
