//! Torsion, varying curvature, bevel offset, duty cycle and their composition into a plant.

use std::f64::consts::{FRAC_PI_4, TAU};

use nalgebra::{SVector, Vector6};
use needle_model::{
    BevelOffset, CurvatureProfile, DutyCycle, Input, LaggedState, Needle, PhysicalNeedle, Pose,
    StaticWindUp, Torsion, TorsionalLag,
};
use proptest::prelude::*;

use crate::finite_difference::derivative;
use crate::kinematics::twist_within;

const KAPPA_PER_MM: f64 = 1.0 / 150.0;

fn needle() -> Needle {
    Needle::new(KAPPA_PER_MM).unwrap()
}

fn turning(omega_rad_s: f64) -> Input {
    Input {
        v_mm_s: 5.0,
        omega_rad_s,
    }
}

#[test]
fn without_effects_the_physical_needle_is_the_exact_step() {
    let plant = PhysicalNeedle::from(needle());
    let mut state = plant.at_entry(&Pose::identity());
    let mut pose = Pose::identity();
    for k in 0..50 {
        let input = turning(f64::from(k) * 0.1 - 2.0);
        state = plant.step(&state, input, 0.1).unwrap();
        pose = needle().step(&pose, input, 0.1).unwrap();
    }
    // omega dt / dt may differ from omega in the last digit.
    assert!(plant.tip(&state).error_from(&pose).norm() < 1e-13);
}

#[test]
fn first_order_lag_reaches_tau_omega_and_conserves_rotation() {
    let torsion = Torsion::FirstOrder(TorsionalLag::new(0.5).unwrap());
    let (mut lag, mut tip) = (0.0, 0.0);
    for _ in 0..200 {
        let step = torsion.advance(lag, 2.0, 50.0, 0.1);
        lag = step.lag_rad;
        tip += step.tip_rotation_rad;
    }
    // exp(-40) is below rounding; what the base turned is in the tip or in the lag.
    assert!((lag - 1.0).abs() < 1e-13, "{lag}");
    assert!((tip + lag - 40.0).abs() < 1e-11);
}

#[test]
fn first_order_lag_does_not_depend_on_the_step() {
    let torsion = Torsion::FirstOrder(TorsionalLag::new(0.3).unwrap());
    let once = torsion.advance(0.2, 1.5, 0.0, 0.4);
    let half = torsion.advance(0.2, 1.5, 0.0, 0.2);
    let twice = torsion.advance(half.lag_rad, 1.5, 0.0, 0.2);
    assert!((once.lag_rad - twice.lag_rad).abs() < 1e-15);
}

#[test]
fn static_wind_up_holds_the_published_lag_at_100_mm() {
    // Reed, Okamura, Cowan 2009: more than 45 degrees at 100 mm depth.
    let shaft = StaticWindUp::at_depth(FRAC_PI_4, 100.0).unwrap();
    let torsion = Torsion::WindUp(shaft);
    let held = torsion.advance(0.0, 0.7, 100.0, 1.0);
    assert_eq!(held.tip_rotation_rad, 0.0);
    let slipped = torsion.advance(0.0, 10.0, 100.0, 1.0);
    assert!((slipped.lag_rad - FRAC_PI_4).abs() < 1e-15);
    // A reversal has to unwind the shaft and wind it up the other way first.
    let reversed = torsion.advance(slipped.lag_rad, -FRAC_PI_4, 100.0, 1.9);
    assert_eq!(reversed.tip_rotation_rad, 0.0);
    assert!((shaft.limit_rad(50.0) - FRAC_PI_4 / 4.0).abs() < 1e-15);
}

#[test]
fn varying_curvature_converges_to_its_integral_with_order_two() {
    // In a plane the heading is the integral of curvature: kappa (1 + s / 200) over 100 mm.
    let plant = PhysicalNeedle {
        curvature: CurvatureProfile::new(&[(0.0, 0.005), (100.0, 0.0075)]).unwrap(),
        ..PhysicalNeedle::from(needle())
    };
    let end = |steps: u32| {
        let mut state = plant.at_entry(&Pose::identity());
        for _ in 0..steps {
            let dt_s = 20.0 / f64::from(steps);
            state = plant.step(&state, turning(0.0), dt_s).unwrap();
        }
        state
    };
    let heading = end(7).frame.log()[3];
    // The midpoint rule integrates a linear function exactly.
    assert!((heading - 0.625).abs() < 1e-13, "{heading}");
    let position = |steps| end(steps).frame.position_mm;
    let order =
        ((position(20) - position(40)).norm() / (position(40) - position(80)).norm()).log2();
    assert!((order - 2.0).abs() < 0.05, "{order}");
}

#[test]
fn bad_profiles_and_shafts_are_refused_by_name() {
    assert!(CurvatureProfile::new(&[]).is_err());
    assert!(CurvatureProfile::new(&[(0.0, 0.1), (0.0, 0.1)]).is_err());
    assert!(CurvatureProfile::new(&[(0.0, -0.1)]).is_err());
    assert!(CurvatureProfile::new(&[(f64::NAN, 0.1)]).is_err());
    assert!(TorsionalLag::new(0.0).is_err() && TorsionalLag::new(f64::INFINITY).is_err());
    assert!(
        StaticWindUp::at_depth(1.0, 0.0).is_err() && StaticWindUp::at_depth(-1.0, 1.0).is_err()
    );
    assert!(DutyCycle::new(1.1).is_err() && DutyCycle::new(f64::NAN).is_err());
    assert!(DutyCycle::for_curvature(needle(), 0.1).is_err());
}

#[test]
fn a_profile_is_linear_between_knots_and_constant_beyond() {
    let profile = CurvatureProfile::new(&[(10.0, 0.01), (20.0, 0.03)]).unwrap();
    let at = |s: f64| profile.at(s).curvature_per_mm();
    assert_eq!(
        [at(-5.0), at(10.0), at(20.0), at(99.0)],
        [0.01, 0.01, 0.03, 0.03]
    );
    assert!((at(15.0) - 0.02).abs() < 1e-17);
}

#[test]
fn turning_in_place_moves_no_tip_and_tilting_moves_an_offset_tip_only() {
    let offset = BevelOffset { offset_mm: 20.0 };
    let frame = Pose::exp(&Vector6::new(1.0, 2.0, 3.0, 0.3, -0.2, 0.1));
    let tip = offset.tip(&frame);
    assert!((tip.position_mm - frame.position_mm - frame.tangent() * 20.0).norm() < 1e-14);
    assert!(offset.frame(&tip).error_from(&frame).norm() < 1e-14);
    let turned = needle()
        .step(
            &frame,
            Input {
                v_mm_s: 0.0,
                omega_rad_s: 1.0,
            },
            1.0,
        )
        .unwrap();
    assert!((offset.tip(&turned).position_mm - tip.position_mm).norm() < 1e-13);
}

/// Final heading of a needle that really spins during a fraction of each cycle.
fn duty_cycled_heading(duty: f64, cycles: u32) -> Vector6<f64> {
    let cycle_s = 20.0 / f64::from(cycles);
    let spin_s = duty * cycle_s;
    let mut pose = Pose::identity();
    for _ in 0..cycles {
        pose = needle()
            .step(&pose, turning(0.0), cycle_s - spin_s)
            .unwrap();
        pose = needle().step(&pose, turning(TAU / spin_s), spin_s).unwrap();
    }
    pose.log()
}

#[test]
fn real_duty_cycles_converge_to_the_averaged_needle() {
    let duty = DutyCycle::new(0.4).unwrap();
    let averaged = duty.averaged(needle());
    let exact = averaged
        .step(&Pose::identity(), turning(0.0), 20.0)
        .unwrap()
        .log();
    let coarse = (duty_cycled_heading(0.4, 50) - exact).norm();
    let fine = (duty_cycled_heading(0.4, 100) - exact).norm();
    // First order in the length of a cycle: halving it halves the deviation.
    assert!((coarse / fine - 2.0).abs() < 0.1, "{coarse} {fine}");
    assert!(fine < 0.5, "{fine}");
    let round_trip = DutyCycle::for_curvature(needle(), averaged.curvature_per_mm()).unwrap();
    assert!((round_trip.fraction() - 0.4).abs() < 1e-15);
}

#[test]
fn a_lagging_needle_converges_with_order_two() {
    let torsion = Torsion::FirstOrder(TorsionalLag::new(0.4).unwrap());
    let plant = PhysicalNeedle {
        torsion,
        ..PhysicalNeedle::from(needle())
    };
    let end = |steps: u32| {
        let mut state = plant.at_entry(&Pose::identity());
        for _ in 0..steps {
            state = plant
                .step(&state, turning(3.0), 2.0 / f64::from(steps))
                .unwrap();
        }
        state.frame.position_mm
    };
    // The mean rate of a step stands for one that decays within it.
    let order = ((end(20) - end(40)).norm() / (end(40) - end(80)).norm()).log2();
    assert!((order - 2.0).abs() < 0.1, "{order}");
}

#[test]
fn the_estimators_needle_is_the_plant_with_a_first_order_lag() {
    let lag = TorsionalLag::new(0.4).unwrap();
    let plant = PhysicalNeedle {
        torsion: Torsion::FirstOrder(lag),
        ..PhysicalNeedle::from(needle())
    };
    let mut state = plant.at_entry(&Pose::identity());
    let mut estimate = lagged(&Pose::identity(), &SVector::zeros(), KAPPA_PER_MM, 0.0);
    for k in 0..40 {
        let input = turning((f64::from(k) * 0.2).cos() * 3.0);
        state = plant.step(&state, input, 0.1).unwrap();
        estimate = estimate.step(lag, input, 0.1).unwrap();
    }
    assert!(estimate.pose.error_from(&state.frame).norm() < 1e-12);
    assert!((estimate.lag_rad - state.lag_rad).abs() < 1e-14);
}

fn lagged(at: &Pose, x: &SVector<f64, 8>, kappa: f64, lag: f64) -> LaggedState {
    LaggedState {
        pose: at.perturbed(&x.fixed_rows::<6>(0).into_owned()),
        needle: Needle::new(kappa + x[6]).unwrap(),
        lag_rad: lag + x[7],
    }
}

proptest! {
    #[test]
    fn lagged_jacobians_equal_central_differences(
        at in twist_within(50.0, 3.0), kappa in 0.01..0.05_f64, lag in -1.0..1.0_f64,
        v in -10.0..10.0_f64, omega in -6.0..6.0_f64, tau in 0.05..2.0_f64,
    ) {
        let at = Pose::exp(&at);
        let torsion = TorsionalLag::new(tau).unwrap();
        let input = Input { v_mm_s: v, omega_rad_s: omega };
        let nominal = lagged(&at, &SVector::zeros(), kappa, lag);
        let after = nominal.step(torsion, input, 0.1).unwrap();
        let j = nominal.linearise(torsion, input, 0.1).unwrap();
        let change = |s: LaggedState| {
            let xi = s.pose.error_from(&after.pose);
            let mut out = SVector::<f64, 8>::zeros();
            out.fixed_rows_mut::<6>(0).copy_from(&xi);
            out[6] = s.needle.curvature_per_mm() - kappa;
            out[7] = s.lag_rad - after.lag_rad;
            out
        };
        for i in 0..8 {
            let column = derivative(1e-3, |t| {
                let x = SVector::<f64, 8>::ith(i, t);
                change(lagged(&at, &x, kappa, lag).step(torsion, input, 0.1).unwrap())
            });
            prop_assert!((column - j.a.column(i)).norm() < 1e-8, "state {i}");
        }
        let by_v = derivative(1e-3, |t| {
            change(nominal.step(torsion, Input { v_mm_s: v + t, ..input }, 0.1).unwrap())
        });
        let by_omega = derivative(1e-3, |t| {
            change(nominal.step(torsion, Input { omega_rad_s: omega + t, ..input }, 0.1).unwrap())
        });
        prop_assert!((by_v - j.b.column(0)).norm() < 1e-8);
        prop_assert!((by_omega - j.b.column(1)).norm() < 1e-8);
    }
}
