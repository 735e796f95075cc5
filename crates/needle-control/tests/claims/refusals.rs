//! What `TerminalChoice::Auto` passed over stays readable.

use crate::linear::{HELIX, needle, path};
use needle_control::{
    LinearConfiguration, LtvController, NmpcConfiguration, NmpcController, TerminalChoice,
    TerminalError,
};
use needle_model::Input;

const ARC: Input = Input {
    v_mm_s: 5.0,
    omega_rad_s: 0.0,
};

fn ltv(input: Input, steps: usize, terminal: TerminalChoice) -> LtvController {
    let configuration = LinearConfiguration {
        terminal,
        ..LinearConfiguration::default()
    };
    LtvController::new(needle(), path(needle(), input, steps), configuration).unwrap()
}

#[test]
fn auto_keeps_why_the_stronger_choice_was_refused() {
    let controller = ltv(ARC, 60, TerminalChoice::Auto);
    assert_eq!(controller.terminal(), TerminalChoice::RiccatiChain);
    let refused = controller.refused_terminals();
    assert_eq!(refused.len(), 1);
    assert_eq!(refused[0].choice, TerminalChoice::HelixDare);
    let reason = &refused[0].reason;
    assert!(
        matches!(reason, TerminalError::Dare { report, .. } if report.dimension == 4),
        "{reason}"
    );
}

#[test]
fn nothing_is_refused_where_the_strongest_choice_is_had_or_one_is_asked_for_by_name() {
    for (input, choice) in [
        (HELIX, TerminalChoice::Auto),
        (ARC, TerminalChoice::RiccatiChain),
        (ARC, TerminalChoice::None),
    ] {
        let controller = ltv(input, 60, choice);
        assert!(controller.refused_terminals().is_empty(), "{choice:?}");
    }
}

#[test]
fn a_path_too_long_for_a_chain_is_told_as_such() {
    let controller = ltv(ARC, 5_001, TerminalChoice::Auto);
    assert_eq!(controller.terminal(), TerminalChoice::None);
    let last = &controller.refused_terminals()[1];
    assert!(
        matches!(last.reason, TerminalError::TooLong { steps: 5_001, .. }),
        "{}",
        last.reason
    );
}

#[test]
fn the_nonlinear_controllers_own_weights_refuse_every_terminal_set() {
    let path = path(needle(), HELIX, 60);
    let controller = NmpcController::new(needle(), path, NmpcConfiguration::default()).unwrap();
    let refused = controller.refused_terminals();
    assert_eq!(refused.len(), 2);
    for refused in refused {
        assert!(matches!(refused.reason, TerminalError::SpinAtRest));
    }
}
