//! Closed-loop samples a second on one core: controller, plant, sensors, estimator and bookkeeping together.
//!
//! `cargo bench -p needle-sim --bench closed_loop`; criterion prints the throughput in elements, which are samples.

// A bench that cannot be set up has nothing to measure.
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use needle_sim::Experiment;
use needle_sim::scenario::{Document, Preset};

/// A helix that the needle executes: the time-varying controller wants one.
const HELIX: &str = "\
needle.curvature_per_mm = 0.0066666667
reference.kind = 'inputs'
controller.name = 'ltv'
[[reference.segments]]
duration_s = 20.0
v_mm_s = 5.0
omega_rad_s = 0.5
";

fn bench(criterion: &mut Criterion) {
    let clinical = Preset::named("clinical").unwrap().toml;
    let mut group = criterion.benchmark_group("closed_loop");
    for (name, text, edits) in [
        ("feed_forward", HELIX, &["controller.name=feed_forward"][..]),
        ("sliding_mode", HELIX, &["controller.name=sliding_mode"]),
        ("ltv_20_set", HELIX, &[]),
        ("ltv_20_no_set", HELIX, &["controller.terminal=none"]),
        ("nmpc_20", HELIX, &["controller.name=nmpc"]),
        ("clinical_nmpc_20_filter", clinical, &[]),
        ("clinical_pid_filter", clinical, &["controller.name=pid"]),
    ] {
        let mut document = Document::parse(text).unwrap();
        for edit in edits {
            let (key, value) = edit.split_once('=').unwrap();
            if key == "controller.name" {
                let table = toml::Table::from_iter([("name".to_owned(), value.into())]);
                document.set("controller", table).unwrap();
            } else {
                document.set(key, value).unwrap();
            }
        }
        let experiment = Experiment::new(&document.scenario().unwrap()).unwrap();
        let samples = experiment.summarise(0).unwrap().steps;
        let mut index = 0;
        group.throughput(Throughput::Elements(samples));
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                index += 1;
                experiment.summarise(index).unwrap()
            });
        });
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
