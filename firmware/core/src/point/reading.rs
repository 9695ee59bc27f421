//! What was read of which ball, and what is asked of it.

use nalgebra::Vector3;

use crate::units::{Mm, Point};

/// One reading of a ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallReading {
    /// Position of the axes, Q.
    pub axes: Point,
    /// What the sensor read along its beam, γ.
    pub gamma: Mm,
    /// Index of the ball that the beam struck, from 0.
    pub ball: usize,
}

/// A ball whose centre and radius are known from elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationBall {
    /// Centre, in the coordinates of the axes.
    pub center: Point,
    /// Radius.
    pub radius: Mm,
    /// Standard uncertainty of the centre along each axis; 0 if not known.
    pub u_center: Mm,
    /// Standard uncertainty of the radius; 0 if not known.
    pub u_radius: Mm,
}

/// What one error of a reading looks like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ResidualNoise {
    /// Distances from the ball scatter alike everywhere: the machine's noise
    /// and the surface's outweigh the sensor's. All residuals count alike.
    #[default]
    Everywhere,
    /// The sensor's own noise outweighs the rest. It moves a point along the
    /// beam, so it shows in the distance from the ball times |n·a| only: a
    /// residual counts as d / |n·a|, where |n·a| is taken as 0.2 at least.
    AlongBeam,
}

/// What is asked of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointQuestion {
    /// Rough direction of the beam, of any length: a has a positive part along it.
    pub direction: Vector3<f64>,
    /// Find an error of the radius too. Only with readings of one ball.
    pub free_radius: bool,
    /// Find the gain of the readings too.
    pub free_gain: bool,
    /// How residuals are weighted.
    pub noise: ResidualNoise,
}

impl Default for PointQuestion {
    /// A beam that points down, radius and gain as given.
    fn default() -> Self {
        Self {
            direction: Vector3::new(0.0, 0.0, -1.0),
            free_radius: false,
            free_gain: false,
            noise: ResidualNoise::Everywhere,
        }
    }
}
