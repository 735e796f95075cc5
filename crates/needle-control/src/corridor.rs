//! The corridor: how far aside of the path the tip may be.
//!
//! |n'(p_k - p_r,k)| <= w at the predicted samples k = 1 to N, along both cross axes n of the reference's frame (its x and y): a square tube
//! about the path, w at its walls and sqrt(2) w at its edges. With right perturbations delta of a pose (R, p) the offset is
//! n'(p - p_r) + n'R delta_p to first order, and delta_{k+1} = A delta_k + B u + c makes it four rows of stage k, so that the last sample has its own.
//!
//! A measured tip may be outside. Walls at w would then ask to be back at once, at full bend, and a horizon of a few millimetres does not see the
//! swing to the other side that follows. So a wall that a tip coasting beside the path is beyond stands at that tip, and
//! follows it in, sample by sample; the other walls stay. It is the cost that brings the tip back, as without a corridor. A tip that heads outward by
//! h must go on by h^2 / (2 kappa') before it comes back, with kappa' the needle's bend against the path's: a wall short of that would be kept best by
//! a needle that stands still, so it stands there.
//!
//! The walls are soft, at an L1 price: where it exceeds their multipliers a plan keeps them whenever one does.

use mpc_qp::{Penalty, Row, Softening, Stage};
use nalgebra::{SVector, Vector2, Vector3};
use needle_model::Pose;

/// Part of the half-width that counts as none: what linearising leaves out.
const ON_THE_WALL: f64 = 1e-3;

/// A tube about the path, and what leaving it costs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Corridor {
    half_width_mm: f64,
    /// Of a millimetre beyond a wall at one sample, in the units of the cost.
    pub(crate) price_per_mm: f64,
    /// Offsets across the path, in the world, of the measured tip and of where it turns back at the earliest, mm.
    unavoidable_mm: [Vector3<f64>; 2],
}

/// Bend of a needle that is as good as straight, 1/mm.
const STRAIGHT_PER_MM: f64 = 1e-9;

/// Share of the bend to spare with which a tip that heads outward is expected to turn back: the roll is not there at once.
const TURNING_SHARE: f64 = 1.0;

/// Least part of the needle's bend that a path leaves it to turn back with.
const LEAST_SPARE: f64 = 0.1;

/// Rows of a stage that are its walls, the first ones: two sides along two axes.
pub(crate) const WALLS: usize = 4;

/// Sides of the path along an axis.
const SIDES: [f64; 2] = [1.0, -1.0];

impl Corridor {
    /// Of a half-width, where there is one, at a price in the units of the cost.
    pub(crate) fn of(half_width_mm: Option<f64>, price_per_mm: f64) -> Option<Self> {
        half_width_mm.map(|half_width_mm| Self {
            half_width_mm,
            price_per_mm,
            unavoidable_mm: [Vector3::zeros(); 2],
        })
    }

    /// Puts the walls about `reference`, which bends by `bending_per_mm` (a vector in the world), no nearer than the measured tip of a needle of
    /// curvature `kappa_per_mm` must go.
    pub(crate) fn enclose(
        &mut self,
        tip: &Pose,
        reference: &Pose,
        kappa_per_mm: f64,
        bending_per_mm: &Vector3<f64>,
    ) {
        let tangent = reference.tangent();
        let across = |v: Vector3<f64>| v - tangent * tangent.dot(&v);
        let tip_mm = across(tip.position_mm - reference.position_mm);
        let heading = across(tip.tangent());
        let outward = heading.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let spare_per_mm = kappa_per_mm + bending_per_mm.dot(&outward);
        let least_per_mm = (LEAST_SPARE * kappa_per_mm).max(STRAIGHT_PER_MM);
        let way_mm = heading.norm() / (2.0 * TURNING_SHARE * spare_per_mm.max(least_per_mm));
        self.unavoidable_mm = [tip_mm, tip_mm + heading * way_mm];
    }

    /// Distances of the walls of either side about a pose of the reference. The frame may turn under a tip that coasts.
    fn walls_mm(&self, reference: &Pose) -> [Vector2<f64>; 2] {
        let offsets_mm = self
            .unavoidable_mm
            .map(|mm| (reference.rotation.inverse() * mm).xy());
        SIDES.map(|side| {
            let half_width_mm = Vector2::repeat(self.half_width_mm);
            offsets_mm
                .iter()
                .fold(half_width_mm, |walls, mm| walls.sup(&(mm * side)))
        })
    }

    /// The walls' price in a program whose costs carry the factor 1/2.
    pub(crate) fn softening(&self) -> Softening {
        Softening {
            rows: Penalty::Exact {
                weight: 0.5 * self.price_per_mm,
            },
            ..Softening::default()
        }
    }

    /// Rows for [`Self::write`] to fill.
    pub(crate) fn blank_rows<const NX: usize>() -> Vec<Row<NX, 2>> {
        let open = Row {
            g_x: SVector::zeros(),
            h_u: SVector::zeros(),
            upper: f64::INFINITY,
        };
        vec![open; WALLS]
    }

    /// Writes the walls about `reference` at the end of a stage into its first rows: the state after it is the perturbation of `pose`.
    pub(crate) fn write<const NX: usize>(
        &self,
        stage: &mut Stage<NX, 2>,
        pose: &Pose,
        reference: &Pose,
    ) {
        let offset_mm = across_mm(pose, reference);
        let walls_mm = self.walls_mm(reference);
        let to_body = pose.rotation.inverse() * reference.rotation;
        let axes = to_body.to_rotation_matrix();
        for (axis, rows) in stage.rows.chunks_exact_mut(2).take(2).enumerate() {
            let normal = axes.matrix().column(axis);
            let by_x = stage.a.fixed_rows::<3>(0).tr_mul(&normal);
            let by_u = stage.b.fixed_rows::<3>(0).tr_mul(&normal);
            let there_mm = offset_mm[axis] + stage.c.fixed_rows::<3>(0).dot(&normal);
            for (i, row) in rows.iter_mut().enumerate() {
                row.g_x = by_x * SIDES[i];
                row.h_u = by_u * SIDES[i];
                row.upper = walls_mm[i][axis] - SIDES[i] * there_mm;
            }
        }
    }

    /// What the poses after the first cost by being beyond the walls.
    pub(crate) fn cost(&self, poses: &[Pose], reference: &[Pose]) -> f64 {
        let pairs = poses.iter().zip(reference).skip(1);
        let beyond_mm = |(pose, there): (&Pose, &Pose)| {
            let (offset_mm, walls_mm) = (across_mm(pose, there), self.walls_mm(there));
            let of_side = |(sign, walls): (f64, Vector2<f64>)| {
                (offset_mm * sign - walls).map(|mm| mm.max(0.0)).sum()
            };
            SIDES.into_iter().zip(walls_mm).map(of_side).sum::<f64>()
        };
        self.price_per_mm * pairs.map(beyond_mm).sum::<f64>()
    }

    /// How far the poses after the first are outside of the corridor at most, mm; zero within what linearising leaves out.
    pub(crate) fn left_by_mm(&self, poses: impl Iterator<Item = Pose>, reference: &[Pose]) -> f64 {
        let pairs = poses.zip(reference).skip(1);
        let farthest_mm = pairs
            .map(|(pose, there)| across_mm(&pose, there).amax())
            .fold(0.0, f64::max);
        match farthest_mm > (1.0 + ON_THE_WALL) * self.half_width_mm {
            true => farthest_mm - self.half_width_mm,
            false => 0.0,
        }
    }
}

/// Offset of a pose from another's tangent line, in the other's cross axes, mm.
fn across_mm(pose: &Pose, reference: &Pose) -> Vector2<f64> {
    let offset = reference.rotation.inverse() * (pose.position_mm - reference.position_mm);
    offset.xy()
}
