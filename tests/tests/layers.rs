//! The layers of docs/architecture.md, read off the manifests: an edge that is not drawn there fails.

// What a test's own functions cannot unwrap fails the test.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeSet;
use std::path::Path;

/// The crates of the workspace that a crate may depend on, in any of its dependency tables.
const LAYERS: [(&str, &[&str]); 8] = [
    ("crates/needle-model", &[]),
    ("crates/lqr", &[]),
    ("crates/mpc-qp", &[]),
    ("crates/needle-control", &["needle-model", "lqr", "mpc-qp"]),
    (
        "crates/needle-sim",
        &["needle-model", "lqr", "mpc-qp", "needle-control"],
    ),
    (
        "crates/needle-cli",
        &["needle-model", "needle-control", "needle-sim"],
    ),
    ("xtask", &["needle-sim"]),
    ("tests", &["needle-model", "lqr", "needle-control"]),
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

fn manifest(folder: &str) -> toml::Table {
    let path = root().join(folder).join("Cargo.toml");
    std::fs::read_to_string(&path)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()))
        .parse()
        .unwrap()
}

/// What a dependency's name stands for: a rename hides its crate behind `package`, here or in the workspace's table.
fn package(name: &str, entry: &toml::Value, workspace: &toml::Table) -> String {
    let renamed = |entry: &toml::Value| entry.get("package")?.as_str().map(String::from);
    renamed(entry)
        .or_else(|| renamed(workspace.get(name)?))
        .unwrap_or_else(|| name.into())
}

/// Names of workspace crates in any table called `*dependencies`, those under `target` included.
fn edges(
    table: &toml::Table,
    workspace: &toml::Table,
    crates: &BTreeSet<String>,
) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (key, value) in table {
        let Some(inner) = value.as_table() else {
            continue;
        };
        if key.ends_with("dependencies") {
            let packages = inner
                .iter()
                .map(|(name, entry)| package(name, entry, workspace));
            found.extend(packages.filter(|name| crates.contains(name)));
        } else {
            found.extend(edges(inner, workspace, crates));
        }
    }
    found
}

/// The table of dependencies that the members share.
fn shared_dependencies() -> toml::Table {
    manifest(".")["workspace"]["dependencies"]
        .as_table()
        .unwrap()
        .clone()
}

fn crate_name(folder: &str) -> String {
    manifest(folder)["package"]["name"].as_str().unwrap().into()
}

#[test]
fn no_crate_depends_on_one_beside_or_above_it() {
    let crates: BTreeSet<String> = LAYERS
        .iter()
        .map(|(folder, _)| crate_name(folder))
        .collect();
    for (folder, allowed) in LAYERS {
        let allowed: BTreeSet<String> = allowed.iter().map(|name| (*name).into()).collect();
        let found = edges(&manifest(folder), &shared_dependencies(), &crates);
        let wrong: Vec<_> = found.difference(&allowed).collect();
        assert!(
            wrong.is_empty(),
            "{folder} must not depend on {wrong:?}: see docs/architecture.md"
        );
    }
}

#[test]
fn every_member_has_its_place_in_the_layers() {
    let listed: BTreeSet<String> = LAYERS.iter().map(|(folder, _)| (*folder).into()).collect();
    let crates = std::fs::read_dir(root().join("crates"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name());
    let members = crates.map(|name| format!("crates/{}", name.to_str().unwrap()));
    let members: BTreeSet<String> = members.chain(["xtask".into(), "tests".into()]).collect();
    assert_eq!(members, listed);
}

#[test]
fn an_edge_between_leaves_would_be_seen() {
    let crates = BTreeSet::from(["lqr".to_owned(), "mpc-qp".to_owned()]);
    let workspace = "riccati = { package = \"lqr\", version = \"1\" }"
        .parse()
        .unwrap();
    for text in [
        "[dependencies]\nlqr = \"1\"",
        "[dev-dependencies]\nlqr.workspace = true",
        "[dependencies]\nsolver = { package = \"lqr\", version = \"1\" }",
        "[dependencies]\nriccati.workspace = true",
        "[target.'cfg(unix)'.build-dependencies]\nlqr = \"1\"",
    ] {
        let found = edges(&text.parse().unwrap(), &workspace, &crates);
        assert_eq!(found, BTreeSet::from(["lqr".to_owned()]), "{text}");
    }
}
