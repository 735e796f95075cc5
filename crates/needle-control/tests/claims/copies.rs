//! What survival owes to a copy of a controller, and to the first pose after samples without one.

use crate::scene::CURVATURE_PER_MM;
use crate::scene::DT_S;
use crate::survival::{helix, on_time};

use needle_control::{
    Controller, LinearConfiguration, LtvController, Measurement, NmpcConfiguration, NmpcController,
    Origin,
};
use needle_model::{Needle, Pose};

#[test]
fn copy_of_a_fresh_controller_bridges_a_gap_as_the_controller_does() {
    let (needle, path) = (Needle::new(CURVATURE_PER_MM).unwrap(), helix(100));
    let nmpc = NmpcController::new(needle, path.clone(), NmpcConfiguration::default()).unwrap();
    let ltv = LtvController::new(needle, path, LinearConfiguration::default()).unwrap();
    let copies: [Box<dyn Controller>; 2] = [Box::new(nmpc.clone()), Box::new(ltv.clone())];
    for mut controller in copies {
        controller.step(&Measurement::of(Pose::identity()), 0.0);
        for age in 1..=10 {
            let origin = controller
                .step(&Measurement::default(), on_time(age))
                .origin;
            assert_eq!(origin, Origin::ShiftedPlan { age });
        }
    }
}
