use super::{check_consistent, finding, folder, load_manifest, square_gltf, write};
use glam::{Vec2, Vec3};
use lightkiln::error::Error;
use lightkiln::manifest::{Manifest, Preset, Technique, Up};
use lightkiln::scene::{Role, load_file};
use serde_json::json;
use std::path::Path;

const HEAD: &str = "[[scene]]\nname = 'a'\npath = 'scene.gltf'\n";

/// Field, problem and remedy of the refusal.
fn refusal(text: &str) -> [String; 3] {
    match Manifest::parse(text, Path::new("m.toml")) {
        Err(Error::Manifest {
            file,
            field,
            problem,
            remedy,
        }) => {
            assert_eq!(file, Path::new("m.toml"));
            [field, problem, remedy]
        }
        other => panic!("not refused: {other:?}\n{text}"),
    }
}

#[test]
fn unknown_names_are_answered_with_the_nearest() {
    let [field, problem, remedy] = refusal(&format!("{HEAD}metre_per_unit = 2.0\n"));
    assert_eq!(
        (field.as_str(), problem.as_str()),
        ("line 4", "unknown key `metre_per_unit`")
    );
    assert!(
        remedy.starts_with("did you mean `metres_per_unit`?"),
        "{remedy}"
    );
    let [field, _, remedy] = refusal(&format!("{HEAD}[[scene.bake]]\ntechnique = 'prn'\n"));
    assert_eq!(field, "line 5");
    assert!(remedy.starts_with("did you mean `prm`?"), "{remedy}");
    let role = format!("{HEAD}[[scene.role]]\nmatch = 'node:x'\nrole = 'dynamik'\n");
    assert!(refusal(&role)[2].starts_with("did you mean `dynamic`?"));
    assert!(refusal("[[scenes]]\n")[2].starts_with("did you mean `scene`?"));
}

#[test]
fn what_this_version_cannot_do_is_said() {
    for technique in ["auto", "portal", "object", "sphere_set", "box_transfer"] {
        let [_, problem, remedy] = refusal(&format!(
            "{HEAD}[[scene.bake]]\ntechnique = '{technique}'\n"
        ));
        assert_eq!(
            problem,
            format!("`{technique}` is not available in this version")
        );
        assert_eq!(remedy, "available: prm");
    }
    let [_, problem, _] = refusal(&format!("{HEAD}[scene.domain]\nkind = 'probes'\n"));
    assert_eq!(problem, "`probes` is not available in this version");
}

#[test]
fn values_out_of_range_name_field_and_line() {
    let corner = "corners = [[0,0,0],[1,0,0],[1,1,0],[0,1,0]]";
    for (text, field) in [
        (
            "metres_per_unit = 0.0\n",
            "scene[0].metres_per_unit (line 4)",
        ),
        (
            "metres_per_unit = nan\n",
            "scene[0].metres_per_unit (line 4)",
        ),
        (
            "[[scene.lamp_volume]]\nbox = [[0,0,0],[1,-1,1]]\n",
            "scene[0].lamp_volume[0].box (line 5)",
        ),
        (
            "[[scene.role]]\nrole = 'static'\n",
            "scene[0].role[0] (line 4)",
        ),
        (
            "[scene.domain]\nkind = 'atlas'\npage_size = 3\n",
            "scene[0].domain.page_size (line 6)",
        ),
        (
            "[[scene.material]]\nmatch = 'mesh:a'\nbase_color = [1, 2, 0]\n",
            "scene[0].material[0].base_color (line 6)",
        ),
        (
            "[[scene.bake]]\ntechnique = 'prm'\nsamples = 0\n",
            "scene[0].bake[0].samples (line 6)",
        ),
        (
            "[scene.view]\neye = [0,0,0]\ntarget = [0,0,0]\n",
            "scene[0].view.target (line 6)",
        ),
        (
            &format!("[[scene.portal]]\nname = 'p'\n{corner}\ninward = [1,0,0]\n"),
            "scene[0].portal[0].inward (line 7)",
        ),
        (
            &format!(
                "[[scene.portal]]\nname = 'p'\n{}\ninward = [0,0,1]\n",
                corner.replace("[1,1,0]", "[1,1,1]")
            ),
            "scene[0].portal[0].corners (line 6)",
        ),
    ] {
        assert_eq!(refusal(&format!("{HEAD}{text}"))[0], field);
    }
    for name in ["", "..", "a/b", "a\\b", "c:", "x.", "tab\\t"] {
        let text = format!("[[scene]]\nname = \"{name}\"\npath = 'x.obj'\n");
        assert!(
            Manifest::parse(&text, Path::new("m.toml")).is_err(),
            "{name}"
        );
    }
    let twice = format!("{HEAD}{}", HEAD.replace("'a'", "'A'"));
    assert_eq!(refusal(&twice)[0], "scene[1].name (line 5)");
    assert_eq!(refusal("")[0], "scene");
}

#[test]
fn a_full_manifest_is_mirrored() {
    let text = format!(
        "[output]\ndir = 'out'\n{HEAD}up = '-Z'\n[[scene.bake]]\ntechnique = 'prm'\n\
         preset = 'high'\nentry_density = 2.5\n"
    );
    let manifest = Manifest::parse(&text, Path::new("m.toml")).expect("good");
    let scene = &manifest.scenes[0];
    assert_eq!(scene.up, Some(Up::MinusZ));
    let bake = &scene.bakes[0];
    assert_eq!(
        (bake.technique, bake.preset),
        (Technique::Prm, Some(Preset::High))
    );
    assert_eq!((bake.entry_density, bake.samples), (Some(2.5), None));
    assert_eq!(
        manifest.output_dir(Path::new("x/m.toml")),
        Path::new("x/out")
    );
}

#[test]
fn units_and_axes() {
    let folder = folder();
    // A square whose front looks along each axis in turn; all must come out looking up.
    for (up, a, b) in [
        ("+X", [0, 1, 0], [0, 0, 1]),
        ("-X", [0, 0, 1], [0, 1, 0]),
        ("+Y", [0, 0, 1], [1, 0, 0]),
        ("-Y", [1, 0, 0], [0, 0, 1]),
        ("+Z", [1, 0, 0], [0, 1, 0]),
        ("-Z", [0, 1, 0], [1, 0, 0]),
    ] {
        let v = |p: [i32; 3]| format!("v {} {} {}\n", p[0], p[1], p[2]);
        write(
            &folder,
            "up.obj",
            format!("v 0 0 0\n{}{}f 1 2 3\n", v(a), v(b)),
        );
        let scene = load_manifest(
            folder.path(),
            &format!(
                "[[scene]]\nname = 'a'\npath = 'up.obj'\nup = '{up}'\nmetres_per_unit = 0.1\n\
                 [scene.view]\neye = [{}]\ntarget = [0, 0, 0]\n[[scene.portal]]\nname = 'p'\n\
                 corners = [[0,0,0], {a:?}, {:?}, {b:?}]\ninward = {:?}\n\
                 [[scene.lamp_volume]]\nbox = [[-1, -1, -1], [2, 2, 2]]\n",
                a.map(|x| x.to_string()).join(", "),
                [a[0] + b[0], a[1] + b[1], a[2] + b[2]],
                axis(up),
            ),
        )
        .expect("loads");
        let up_now = scene.double_area_normal(0);
        assert!((up_now - Vec3::Y * 0.01).length() < 1e-8, "{up}: {up_now}");
        assert!((scene.normals[0] - Vec3::Y).length() < 1e-6);
        assert_eq!(scene.view.expect("view").eye, scene.corners(0)[1]);
        let portal = &scene.portals[0];
        assert_eq!(portal.corners[1], scene.corners(0)[1]);
        assert!((portal.inward - Vec3::Y).length() < 1e-6);
        assert!((scene.lamp_volumes[0].diagonal() - 0.3 * 3f32.sqrt()).abs() < 1e-6);
    }
}

fn axis(up: &str) -> [i32; 3] {
    let sign = if up.starts_with('-') { -1 } else { 1 };
    ["X", "Y", "Z"].map(|name| if up.ends_with(name) { sign } else { 0 })
}

/// Two nodes with one mesh and one material: `left` at x 0 to 1, `right` at x 5 to 6.
fn pair(folder: &tempfile::TempDir) {
    square_gltf(
        folder,
        json!({
            "nodes": [
                { "name": "left", "mesh": 0 },
                { "name": "parent", "translation": [5, 0, 0], "children": [2] },
                { "name": "right", "mesh": 0 },
            ],
            "scenes": [{ "nodes": [0, 1] }],
        }),
    );
}

#[test]
fn roles_by_glob_and_box() {
    let folder = folder();
    pair(&folder);
    let roles = |entries: &str| -> Vec<(String, Role, usize)> {
        let scene = load_manifest(folder.path(), &format!("{HEAD}{entries}")).expect("loads");
        check_consistent(&scene);
        let of = |i: &lightkiln::scene::Instance| (i.node.clone(), i.role, i.triangles.len());
        scene.instances.iter().map(of).collect()
    };
    let by_name = roles(
        "[[scene.role]]\nmatch = 'mesh:squ?re'\nrole = 'dynamic'\n\
         [[scene.role]]\nmatch = 'node:par*'\nrole = 'occluder'\n",
    );
    assert_eq!(
        by_name,
        [
            ("left".into(), Role::Dynamic, 2),
            ("right".into(), Role::Occluder, 2)
        ]
    );
    // Takes one triangle of the right square, whose diagonal runs from (5, 0) to (6, 1).
    let by_box = roles(
        "[[scene.role]]\nmatch = 'node:right'\nrole = 'occluder'\n\
         [[scene.role]]\nbox = [[5, -1, 0], [6, 1, 1]]\nrole = 'dynamic'\n\
         [[scene.role]]\nmatch = 'material:*'\nrole = 'static'\n\
         [[scene.role]]\nbox = [[5, 0, 0], [6, 0, 1]]\nrole = 'ignore'\n",
    );
    assert_eq!(
        by_box,
        [
            ("left".into(), Role::Static, 2),
            ("right".into(), Role::Ignore, 2)
        ]
    );
    write(
        &folder,
        "strip.obj",
        "v 0 0 0\nv 0 0 1\nv 1 0 1\nv 1 0 0\nv 9 0 0\nf 1 2 3 4\nf 4 3 5\n",
    );
    let text = "[[scene]]\nname = 'a'\npath = 'strip.obj'\n\
        [[scene.role]]\nbox = [[0, 0, 0], [1, 0, 1]]\nrole = 'dynamic'\n\
        [[scene.role]]\nmatch = 'node:nobody'\nrole = 'ignore'\n";
    let scene = load_manifest(folder.path(), text).expect("loads");
    check_consistent(&scene);
    let roles: Vec<Role> = scene.instances.iter().map(|i| i.role).collect();
    assert_eq!(roles, [Role::Dynamic, Role::Static]);
    assert_eq!(scene.instances[1].triangles, 2..3);
    assert_eq!(
        finding(&scene, "matches nothing").element,
        "role `node:nobody`"
    );
}

#[test]
fn later_material_overrides_win_key_by_key() {
    let folder = folder();
    pair(&folder);
    let text = format!(
        "{HEAD}[[scene.material]]\nmatch = 'material:*'\nbase_color = [0.1, 0.1, 0.1]\n\
         metallic = 0.5\n[[scene.material]]\nmatch = 'material:paint'\nbase_color = [0.2, 0.2, 0.2]\n\
         [[scene.material]]\nmatch = 'node:parent'\nemissive = [1, 2, 3]\ndouble_sided = true\n"
    );
    let scene = load_manifest(folder.path(), &text).expect("loads");
    let [left, right] = [scene.material_of(0), scene.material_of(2)];
    assert_eq!(
        (left.base_color, left.metallic, left.emissive),
        (Vec3::splat(0.2), 0.5, Vec3::ZERO)
    );
    assert_eq!(right.base_color, Vec3::splat(0.2));
    assert_eq!(
        (right.emissive, right.double_sided),
        (Vec3::new(1.0, 2.0, 3.0), true)
    );
    assert!(!left.double_sided);
}

#[test]
fn a_base_colour_replaces_the_texture_but_not_the_mask() {
    let folder = folder();
    let image = super::png(2, 1, |x, _| [200, 10, 10, 255 * x as u8]);
    write(&folder, "mask.png", image);
    square_gltf(
        &folder,
        json!({
            "images": [{ "uri": "mask.png" }], "textures": [{ "source": 0 }],
            "materials": [{ "alphaMode": "MASK",
                "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
        }),
    );
    let file = folder.path().join("scene.gltf");
    assert!(load_file(&file).expect("loads").material_of(0).metallic == 1.0);
    let text = format!(
        "{HEAD}[[scene.material]]\nmatch = 'material:material 0'\nbase_color = [0.3, 0.3, 0.3]\n\
         metallic = 0\n"
    );
    let scene = load_manifest(folder.path(), &text).expect("loads");
    let material = scene.material_of(0);
    assert_eq!(
        material.albedo(&scene.textures, Vec2::new(0.75, 0.5)),
        Vec3::splat(0.3)
    );
    assert!(material.covers(&scene.textures, Vec2::new(0.75, 0.5)));
    assert!(!material.covers(&scene.textures, Vec2::new(0.25, 0.5)));
}
