//! What is seen of the tip: at which rate, how late, with which noise, and what not at all.

use super::keys::{Allowed, Keys};

/// Imaging of the tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensors {
    /// Time between two readings, s.
    pub period_s: f64,
    /// Time from a reading to its arrival at the controller, s.
    pub delay_s: f64,
    /// Standard deviation of the position in each direction, mm.
    pub position_std_mm: f64,
    /// Whether the tip's direction is seen.
    pub tangent_measured: bool,
    /// Standard deviation of the tangent about each of its normals, rad.
    pub tangent_std_rad: f64,
    /// Whether the roll is seen.
    pub roll_measured: bool,
    /// Standard deviation of the roll, rad.
    pub roll_std_rad: f64,
    /// Probability that readings are lost from one on, drawn at each.
    pub dropout_probability: f64,
    /// Readings in a row that are then lost.
    pub dropout_readings: u64,
}

impl Default for Sensors {
    /// Everything, exactly, at once, every 0.1 s.
    fn default() -> Self {
        Self {
            period_s: 0.1,
            delay_s: 0.0,
            position_std_mm: 0.0,
            tangent_measured: true,
            tangent_std_rad: 0.0,
            roll_measured: true,
            roll_std_rad: 0.0,
            dropout_probability: 0.0,
            dropout_readings: 1,
        }
    }
}

impl Sensors {
    pub(super) fn keys(&mut self, keys: &mut dyn Keys) {
        let about = "time between two readings";
        keys.number(
            "period_s",
            &mut self.period_s,
            Allowed::From(1e-3, 1e3),
            about,
        );
        let about = "time from a reading to its arrival at the controller";
        keys.number("delay_s", &mut self.delay_s, Allowed::From(0.0, 1e3), about);
        let about = "standard deviation of the position in each direction";
        let size = Allowed::NOT_NEGATIVE;
        keys.number("position_std_mm", &mut self.position_std_mm, size, about);
        let about = "whether the tip's direction is seen";
        keys.flag("tangent_measured", &mut self.tangent_measured, about);
        let about = "standard deviation of the tangent about each of its normals";
        keys.number("tangent_std_rad", &mut self.tangent_std_rad, size, about);
        let about = "whether the roll is seen; `raw` takes it, `filter` estimates it from the bends either way";
        keys.flag("roll_measured", &mut self.roll_measured, about);
        let about = "standard deviation of the roll";
        keys.number("roll_std_rad", &mut self.roll_std_rad, size, about);
        let about = "probability that readings are lost from one on, drawn at each";
        let share = Allowed::FRACTION;
        keys.number(
            "dropout_probability",
            &mut self.dropout_probability,
            share,
            about,
        );
        let about = "readings in a row that are then lost: an outage";
        let readings = &mut self.dropout_readings;
        keys.count("dropout_readings", readings, (1, 1_000_000), about);
    }
}
