//! `index.json`: its schema, its rules and its determinism.

use lightkiln_format::container::atomic_write;
use lightkiln_format::index::{Asset, FileEntry, Index, Note, SCHEMA};
use serde_json::{Value, json};
use std::path::Path;

fn example(folder: &Path) -> Index {
    let written = atomic_write(&folder.join("data.bin"), b"data").unwrap();
    let note = |element: &str| Note {
        element: element.into(),
        reason: "area 0".into(),
        count: 2,
    };
    let asset = |name: &str| Asset {
        name: name.into(),
        technique: "prm".into(),
        kind: "lightkiln-prm".into(),
        format_version: 1,
        files: vec![FileEntry::new(
            format!("{name}/prm.safetensors"),
            "data",
            written,
        )],
        parameters: json!({ "rays": 1024, "bounces": { "max": 8, "albedo": 0.5 } }),
        plan_key: written.blake3.to_hex().to_string(),
        statistics: json!({ "cells": 4096 }),
        skips: vec![note("mesh `Lamp`")],
        repairs: vec![note("mesh `Chair`, triangle 7")],
    };
    Index {
        assets: vec![asset("room"), asset("attic")],
        ..Index::new("0.1.0")
    }
}

#[test]
fn the_schema_accepts_the_index_and_refuses_broken_ones() {
    let folder = tempfile::tempdir().unwrap();
    let schema: Value = serde_json::from_str(SCHEMA).unwrap();
    jsonschema::meta::validate(&schema).unwrap();
    let schema = jsonschema::validator_for(&schema).unwrap();
    let text = example(folder.path()).to_json().unwrap();
    let good: Value = serde_json::from_str(&text).unwrap();
    schema.validate(&good).unwrap();

    let path = folder.path().join("index.json");
    let file = "/assets/0/files/0";
    let breaks = [
        ("", "schema_version", json!(2)),
        ("", "extra", json!(1)),
        ("", "assets", json!({})),
        ("/assets/0", "name", json!("")),
        ("/assets/0", "technique", json!(3)),
        ("/assets/0", "format_version", json!(-1)),
        ("/assets/0", "parameters", json!([])),
        ("/assets/0", "date", json!("today")),
        ("/assets/0/skips/0", "count", json!("2")),
        (file, "path", json!("../escape")),
        (file, "path", json!("/etc/passwd")),
        (file, "path", json!("a/../../b")),
        (file, "path", json!("C:\\data")),
        (file, "path", json!("")),
        (file, "bytes", json!(1.5)),
        (file, "blake3", json!("abc")),
        (file, "blake3", json!("G".repeat(64))),
    ];
    for (at, key, value) in breaks {
        let mut broken = good.clone();
        broken.pointer_mut(at).unwrap()[key] = value.clone();
        assert!(
            !schema.is_valid(&broken),
            "the schema accepts {at}/{key} = {value}"
        );
        atomic_write(&path, broken.to_string().as_bytes()).unwrap();
        assert!(
            Index::read(&path).is_err(),
            "the reader accepts {at}/{key} = {value}"
        );
    }
    for (at, key) in [
        ("", "tool_version"),
        ("/assets/1", "plan_key"),
        (file, "role"),
    ] {
        let mut broken = good.clone();
        broken
            .pointer_mut(at)
            .unwrap()
            .as_object_mut()
            .unwrap()
            .remove(key);
        assert!(
            !schema.is_valid(&broken),
            "the schema does not need {at}/{key}"
        );
        atomic_write(&path, broken.to_string().as_bytes()).unwrap();
        let error = Index::read(&path).unwrap_err().to_string();
        assert!(
            error.contains("index.json") && error.contains(key),
            "{error}"
        );
    }
}

#[test]
fn the_same_content_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("index.json");
    let index = example(folder.path());
    let mut shuffled = index.clone();
    shuffled.assets.reverse();
    shuffled.assets[0].parameters = json!({ "bounces": { "albedo": 0.5, "max": 8 }, "rays": 1024 });
    assert_eq!(index.to_json().unwrap(), shuffled.to_json().unwrap());
    index.write(&path).unwrap();
    let read = Index::read(&path).unwrap();
    assert_eq!(read.to_json().unwrap(), index.to_json().unwrap());
    assert_eq!(read.assets[0].name, "attic");
}

#[test]
fn one_technique_of_a_scene_appears_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut index = example(folder.path());
    index.assets[1].name = "room".into();
    let error = index
        .write(&folder.path().join("index.json"))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("`room`") && error.contains("`prm`"),
        "{error}"
    );
}
