use super::{check_consistent, finding, folder, png, write};
use glam::{Vec2, Vec3};
use lightkiln::scene::load_file;

#[test]
fn groups_negative_numbers_tabs_and_polygons() {
    let folder = folder();
    write(
        &folder,
        "a.mtl",
        "newmtl red\n\tKd 0.6 0.1 0.1 # red\nnewmtl lamp\nKd 0.5\nKe 17 12 4\n",
    );
    let text = "mtllib a.mtl\n\
        v\t0\t0\t0\nv 0 0 1\nv 1 0 1\nv 1 0 0\n\
        g floor\nusemtl red\nf -4 -3 -2 -1 # a quad\n\
        o ceiling\nusemtl lamp\nf 4 3 \\\n2\n";
    let scene = load_file(&write(&folder, "a.obj", text)).expect("loads");
    check_consistent(&scene);
    let names: Vec<(&str, usize)> = scene
        .instances
        .iter()
        .map(|i| (i.node.as_str(), i.triangles.len()))
        .collect();
    assert_eq!(names, [("floor", 2), ("ceiling", 1)]);
    assert_eq!(scene.double_area_normal(0), Vec3::Y);
    assert_eq!(scene.double_area_normal(2), Vec3::NEG_Y);
    assert_eq!(scene.albedo_at(0, 0.1, 0.1), Vec3::new(0.6, 0.1, 0.1));
    let lamp = scene.material_of(2);
    assert_eq!(
        (lamp.base_color, lamp.emissive),
        (Vec3::splat(0.5), Vec3::new(17.0, 12.0, 4.0))
    );
    assert!(!lamp.double_sided);
}

#[test]
fn concave_polygons_keep_their_area() {
    // An L of three unit squares, its reflex corner third: a fan of the first corner would overlap.
    let folder = folder();
    let text = "v 2 0 0\nv 1 0 0\nv 1 0 -1\nv 0 0 -1\nv 0 0 1\nv 2 0 1\nf 1 2 3 4 5 6\n";
    let scene = load_file(&write(&folder, "l.obj", text)).expect("loads");
    assert_eq!(scene.triangles.len(), 4);
    let area: f32 = (0..4).map(|t| scene.double_area_normal(t).y / 2.0).sum();
    assert_eq!(area, 3.0);
    assert!((0..4).all(|t| scene.double_area_normal(t).y > 0.0));
}

#[test]
fn texture_rows_masks_and_missing_files() {
    let folder = folder();
    // White above, black below; the left column is transparent.
    let image = png(2, 2, |x, y| [255 * (1 - y as u8), 0, 0, 255 * x as u8]);
    write(&folder, "leaf one.png", image);
    write(
        &folder,
        "hole.png",
        png(1, 2, |_, y| [255 * y as u8, 0, 0, 255]),
    );
    write(
        &folder,
        "b.mtl",
        "newmtl leaf\nmap_Kd leaf one.png\nnewmtl lost\nKd 0.3 0.3 0.3\nmap_Kd textures\\no.png\n\
         newmtl cut\nKd 0.2 0.4 0.6\nmap_d -clamp on hole.png\nnewmtl faint\nd 0.25\n",
    );
    let text = "mtllib b.mtl\nmtllib gone.mtl\n\
        v 0 0 0\nv 0 0 1\nv 1 0 1\nv 1 0 0\nvt 0.75 0.75\nvt 0.75 0.1\n\
        usemtl leaf\nf 1/1 2/2 3/1\nusemtl lost\nf 1 2 3\nusemtl cut\nf 1/9 2 3\n\
        usemtl faint\nf 1 2 3\nusemtl unheard\nf 1 2 3\nf 1 2 8\n";
    let scene = load_file(&write(&folder, "b.obj", text)).expect("loads");
    let [leaf, lost, cut, faint, unheard] = [0, 1, 2, 3, 4].map(|i| &scene.materials[i]);
    assert!(leaf.double_sided && leaf.alpha_cutoff == Some(0.5));
    // v = 0.75 of the file is the middle of the upper row: our v = 0.25.
    let uv = scene.uvs[0];
    assert!((uv - Vec2::new(0.75, 0.25)).length() < 1e-6);
    assert_eq!(leaf.albedo(&scene.textures, uv), Vec3::X);
    assert!(leaf.covers(&scene.textures, uv));
    assert!(!leaf.covers(&scene.textures, Vec2::new(0.25, 0.25)));
    assert_eq!(
        (lost.base_color, lost.base_color_texture),
        (Vec3::splat(0.3), None)
    );
    // The mask is 0 above, 1 below, and white otherwise.
    assert!(!cut.covers(&scene.textures, Vec2::new(0.5, 0.0)));
    assert!(cut.covers(&scene.textures, Vec2::new(0.5, 1.0)));
    assert_eq!(
        cut.albedo(&scene.textures, Vec2::ZERO),
        Vec3::new(0.2, 0.4, 0.6)
    );
    assert!(!faint.covers(&scene.textures, Vec2::ZERO));
    assert_eq!(
        (unheard.name.as_str(), unheard.base_color),
        ("unheard", Vec3::splat(0.8))
    );
    finding(&scene, "no.png");
    assert_eq!(
        finding(&scene, "its materials are grey").element,
        "mtllib `gone.mtl`"
    );
    assert_eq!(finding(&scene, "fewer than three existing").count, 1);
    assert_eq!(finding(&scene, "texture or normal numbers").count, 1);
}

#[test]
fn malformed_numbers_name_their_line() {
    let folder = folder();
    for (text, line) in [
        ("v 0 0\n", 1),
        ("v 0 0 0\nv 0 x 0\n", 2),
        ("\n\nf 1/a 2 3\n", 3),
    ] {
        let error = load_file(&write(&folder, "bad.obj", text)).expect_err("must be refused");
        assert!(
            error.to_string().contains(&format!("line {line}")),
            "{error}"
        );
    }
}
