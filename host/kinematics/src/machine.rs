//! A machine: two chains of joints, the sensor's mount and the workpiece's.

use crate::{Joint, Pose};

/// A serial chain that carries the sensor, another that carries the workpiece.
///
/// Joint values (`q`) are given for all joints, in the order of [`Self::joints`], in
/// millimetres and degrees.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisChain {
    /// All axes, as the file lists them.
    pub joints: Vec<Joint>,
    /// Places in `joints`, from the machine's base outwards.
    pub sensor_chain: Vec<usize>,
    /// Likewise for what carries the workpiece.
    pub workpiece_chain: Vec<usize>,
    /// X: the sensor's frame in the machine's frame, joints at 0.
    pub sensor: Pose,
    /// Of the mount, where a calibration said so: wx wy wz tx ty tz in rad and mm, with
    /// `R_true = exp([w]×) R` and `t_true = t + (tx, ty, tz)`.
    pub sensor_covariance: Option<[[f64; 6]; 6]>,
    /// W: the workpiece's frame in the machine's frame, joints at 0.
    pub workpiece: Pose,
}

impl AxisChain {
    /// Where the sensor's frame stands in the workpiece's: `W⁻¹ T_w(q)⁻¹ T_s(q) X`.
    ///
    /// A missing value of a joint counts as 0.
    #[must_use]
    pub fn sensor_in_workpiece(&self, q: &[f64]) -> Pose {
        self.flange_in_workpiece(q).after(&self.sensor)
    }

    /// The same without the mount: `W⁻¹ T_w(q)⁻¹ T_s(q)`.
    #[must_use]
    pub fn flange_in_workpiece(&self, q: &[f64]) -> Pose {
        let table = self
            .product(&self.workpiece_chain, q)
            .after(&self.workpiece);
        table.inverse().after(&self.product(&self.sensor_chain, q))
    }

    /// The sensor in the frame of what carries the joint at a place of the workpiece's chain, with the joints before it
    /// taken back to 0: there the joint's axis stands as the machine file has it. None for a joint that does not carry
    /// the workpiece.
    #[must_use]
    pub fn sensor_before(&self, joint: usize, q: &[f64]) -> Option<Pose> {
        let at = self.workpiece_chain.iter().position(|&j| j == joint)?;
        let carrier = self.product(&self.workpiece_chain[..at], q);
        let flange = self.product(&self.sensor_chain, q);
        Some(carrier.inverse().after(&flange).after(&self.sensor))
    }

    /// The joints that a chain uses, as places in `joints`, in the file's order.
    pub fn moving(&self) -> impl Iterator<Item = (usize, &Joint)> {
        self.joints.iter().enumerate().filter(|(place, _)| {
            self.sensor_chain.contains(place) || self.workpiece_chain.contains(place)
        })
    }

    fn product(&self, chain: &[usize], q: &[f64]) -> Pose {
        chain.iter().fold(Pose::identity(), |pose, &place| {
            let value = q.get(place).copied().unwrap_or(0.0);
            pose.after(&self.joints[place].transform(value))
        })
    }
}
