//! `animate` from outside: what it writes, that it is right, and what it says about input that cannot be used.

use lapbench::body::{Body, Build};
use lapbench::mesh_io::frames::{self, Frames};
use lapbench::mesh_io::{npy, read_mesh, write_mesh};
use lapsolve::mesh::TriangleMesh;
use lapsolve::rotation::{about_axis, product, rotate};
use lapsolve::vector::{Vector, add, distance_squared, scale, sub};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Exit code, stdout, stderr.
fn animate(arguments: &[&str]) -> (i32, String, String) {
    let program = env!("CARGO_BIN_EXE_lapbench-faulty");
    let output = Command::new(program).arg("animate").args(arguments).output().expect("the program starts");
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    (output.status.code().expect("an exit code"), text(output.stdout), text(output.stderr))
}

/// A folder with a template, a target, correspondences between them, and a path for each by name.
struct Scene {
    folder: tempfile::TempDir,
    template: TriangleMesh,
    target: TriangleMesh,
}

fn bodies() -> &'static [Body; 2] {
    static BODIES: OnceLock<[Body; 2]> = OnceLock::new();
    BODIES.get_or_init(|| [Body::new(Build::Template, 3_000), Body::new(Build::Female, 5_000)])
}

impl Scene {
    fn new() -> Self {
        let [template, target] = bodies();
        let folder = tempfile::tempdir().expect("a temporary folder");
        let pairs = lapbench::body::correspondences(template, target, 64);
        let lines: String = pairs.iter().map(|[p, t]| format!("{p}, {t}\n")).collect();
        let scene = Self { folder, template: template.mesh.clone(), target: target.mesh.clone() };
        std::fs::write(scene.path("c.csv"), format!("template, target\n{lines}")).expect("writable");
        write_mesh(&scene.path("t.ply"), &scene.template).expect("writable");
        write_mesh(&scene.path("m.ply"), &scene.target).expect("writable");
        scene
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes poses of the template.
    fn frames(&self, name: &str, poses: &[Vec<Vector>]) {
        let n = poses[0].len();
        let values = poses.concat();
        npy::write(&self.path(name), &[poses.len(), n, 3], values.as_flattened()).expect("writable");
    }

    /// `animate transfer` of these files; `more` are further arguments, in which `@` stands for the folder.
    fn transfer(&self, more: &str) -> (i32, String, String) {
        let base = "transfer --template @/t.ply --target @/m.ply --correspondences @/c.csv --threads 2";
        self.run(&format!("{base} {more}"))
    }

    fn run(&self, arguments: &str) -> (i32, String, String) {
        let folder = self.folder.path().display().to_string();
        let arguments: Vec<String> = arguments.split_whitespace().map(|a| a.replace('@', &folder)).collect();
        animate(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
    }

    fn read(&self, name: &str) -> Frames {
        frames::read(&self.path(name), &self.target).expect("frames of the target")
    }
}

/// Largest distance of corresponding points in diagonals.
fn apart(mesh: &TriangleMesh, a: &[Vector], b: &[Vector]) -> f64 {
    a.iter().zip(b).map(|(&p, &q)| distance_squared(p, q).sqrt()).fold(0.0, f64::max) / mesh.diagonal()
}

#[test]
fn rest_is_exact_rigid_motions_are_rigid_and_every_form_is_written() {
    let scene = Scene::new();
    let rest = scene.template.positions().to_vec();
    let q = product(about_axis(1, 2.5), about_axis(0, -0.8));
    let turned: Vec<Vector> = rest.iter().map(|&p| add(rotate(q, p), [0.4, -0.2, 3.0])).collect();
    let walk = lapbench::body::walk(&bodies()[0], 32);
    scene.frames("f.npy", &[rest.clone(), turned, walk.positions(8), rest]);
    let (code, stdout, stderr) = scene.transfer(
        "--frames @/f.npy --out @/out.npy --sheet @/s.png --preview @/p.png --statistics @/s.csv --plot @/s.svg \
         --pictures 3 --size 40x60",
    );
    assert_eq!(code, 0, "{stderr}");
    assert!(stdout.contains("correspondences") && stdout.contains("alignment"), "{stdout}");
    let out = scene.read("out.npy");
    assert_eq!(out.len(), 4);
    for k in [0, 3] {
        let off = apart(&scene.target, out.frame(k), scene.target.positions());
        assert!(off < 1e-10, "rest pose, frame {k}: {off}");
    }
    // The template is aligned to the target by a similarity; the target must turn by A R A^T, whatever A is.
    let sides = |points: &[Vector]| -> Vec<f64> {
        (0..40).map(|i| distance_squared(points[i * 50], points[i * 31 + 7]).sqrt()).collect()
    };
    let (before, after) = (sides(scene.target.positions()), sides(out.frame(1)));
    assert!(before.iter().zip(&after).all(|(a, b)| (a - b).abs() < 1e-9), "a rigid motion keeps distances");
    assert!(apart(&scene.target, out.frame(1), scene.target.positions()) > 0.5);
    let table = std::fs::read_to_string(scene.path("s.csv")).expect("statistics");
    assert_eq!(table.lines().count(), 5, "{table}");
    assert!(table.starts_with("frame,latency_ms,volume_change"));
    let volume: f64 =
        table.lines().nth(2).and_then(|row| row.split(',').nth(2)?.parse().ok()).expect("a volume");
    assert!(volume.abs() < 1e-9, "a rigid motion keeps the volume: {volume}");
    assert!(std::fs::read_to_string(scene.path("s.svg")).expect("a plot").contains("</svg>"));
    for (name, width) in [("s.png", 3 * 44 + 4), ("p.png", 80)] {
        let bytes = std::fs::read(scene.path(name)).expect("a picture");
        assert_eq!(u32::from_be_bytes(bytes[16..20].try_into().unwrap()), width, "{name}");
    }
    let left: Vec<_> =
        std::fs::read_dir(scene.folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), 9, "no temporary file stays: {left:?}");

    // The same as PLY files and as GLB; the GLB drives the target again.
    for out in ["frames", "a.glb"] {
        let (code, _, stderr) = scene.transfer(&format!("--frames @/f.npy --out @/{out}"));
        assert_eq!(code, 0, "{stderr}");
    }
    let names = |k: usize| format!("frames/frame_{k:04}.ply");
    assert_eq!(std::fs::read_dir(scene.path("frames")).unwrap().count(), 4);
    assert_eq!(read_mesh(&scene.path(&names(2))).unwrap().mesh.positions(), out.frame(2));
    let baked = scene.read("a.glb");
    assert_eq!(baked.len(), 4);
    for k in 0..4 {
        assert!(apart(&scene.target, baked.frame(k), out.frame(k)) < 1e-6);
    }
    let (code, _, stderr) = scene.run("transfer --template @/a.glb --target @/m.ply --out @/again.npy");
    assert_eq!(code, 0, "{stderr}");
    assert!(apart(&scene.target, scene.read("again.npy").frame(0), scene.target.positions()) < 1e-5);
}

#[test]
fn arap_on_top_distorts_fewer_edges_and_leaves_rest_alone() {
    let scene = Scene::new();
    let rest = scene.template.positions().to_vec();
    // Bent at the waist by 80 degrees.
    let bend = |p: &Vector| match p[1] {
        y if y > 1.0 => add(rotate(about_axis(0, 1.4 * ((y - 1.0) / 0.15).min(1.0)), sub(*p, WAIST)), WAIST),
        _ => *p,
    };
    scene.frames("f.npy", &[rest.clone(), rest.iter().map(bend).collect()]);
    let distorted = |arap: u32| -> Vec<f64> {
        let (code, _, stderr) =
            scene.transfer(&format!("--frames @/f.npy --arap {arap} --statistics @/s.csv --out @/o.npy"));
        assert_eq!(code, 0, "{stderr}");
        let table = std::fs::read_to_string(scene.path("s.csv")).expect("statistics");
        table.lines().skip(1).map(|row| row.split(',').nth(6).unwrap().parse().unwrap()).collect()
    };
    let plain = distorted(0);
    let stiff = distorted(10);
    assert!(apart(&scene.target, scene.read("o.npy").frame(0), scene.target.positions()) < 1e-9);
    assert!(plain[1] > 0.001 && stiff[1] < 0.8 * plain[1], "{plain:?} {stiff:?}");
}

#[test]
fn kept_volumes_are_those_at_rest_or_follow_the_template() {
    let scene = Scene::new();
    let rest = scene.template.positions().to_vec();
    let bend = |p: &Vector| match p[1] {
        y if y > 1.0 => add(rotate(about_axis(0, 1.4 * ((y - 1.0) / 0.15).min(1.0)), sub(*p, WAIST)), WAIST),
        _ => *p,
    };
    let bent: Vec<Vector> = rest.iter().map(bend).collect();
    scene.frames("f.npy", &[rest, bent]);
    let changes = |option: &str| -> Vec<f64> {
        let (code, _, stderr) =
            scene.transfer(&format!("--frames @/f.npy {option} --statistics @/s.csv --out @/o.npy"));
        assert_eq!(code, 0, "{stderr}");
        assert!(apart(&scene.target, scene.read("o.npy").frame(0), scene.target.positions()) < 1e-9);
        let table = std::fs::read_to_string(scene.path("s.csv")).expect("statistics");
        table.lines().skip(1).map(|row| row.split(',').nth(2).unwrap().parse().unwrap()).collect()
    };
    let (plain, kept, followed) = (changes(""), changes("--keep-volume=rest"), changes("--keep-volume"));
    assert!(plain[1].abs() > 1e-3, "{plain:?}");
    assert!(kept.iter().all(|change| change.abs() <= 1e-6), "{kept:?}");
    assert!((followed[1] - plain[1]).abs() > 1e-5 && followed[1].abs() > 1e-5, "{plain:?} {followed:?}");
    let open = scene.target.triangles()[..2000].to_vec();
    let open = TriangleMesh::new(scene.target.positions().to_vec(), open).unwrap();
    write_mesh(&scene.path("open.ply"), &open).unwrap();
    let refused =
        "transfer --template @/open.ply --target @/open.ply --frames @/o.npy --keep-volume --out @/no.glb";
    let (code, _, stderr) = scene.run(refused);
    assert!(code == 1 && stderr.contains("the surface is open"), "{stderr}");
    assert!(!scene.path("no.glb").exists());
}

/// About where the template bends.
const WAIST: Vector = [0.0, 1.05, 0.0];

#[test]
fn play_counts_late_frames() {
    let scene = Scene::new();
    scene.frames("f.npy", &[scene.template.positions().to_vec(), scene.template.positions().to_vec()]);
    let (code, stdout, stderr) = scene.transfer("--frames @/f.npy --play 1000 --play-frames 50 --format csv");
    assert_eq!(code, 0, "{stderr}");
    assert!(stdout.contains("of 50 frames late"), "{stdout}");
    let (code, stdout, _) = scene.transfer("--frames @/f.npy --play 1 --play-frames 2");
    assert!(code == 0 && stdout.contains("0 of 2 frames late"), "{stdout}");
}

#[test]
fn correspondences_are_thinned_averaged_proposed_or_of_vertices() {
    let scene = Scene::new();
    scene.frames("f.npy", &[scene.template.positions().to_vec()]);
    // Every triangle of the target is marked, many from one triangle of the template.
    let dense: String =
        (0..scene.target.triangles().len()).map(|t| format!("{} {t}\n", t * 3 / 5 % 3_000)).collect();
    std::fs::write(scene.path("dense.txt"), dense).unwrap();
    let base = "transfer --template @/t.ply --target @/m.ply --frames @/f.npy --out @/o.npy --correspondences @/dense.txt";
    let (code, _, stderr) = scene.run(base);
    assert_eq!(code, 0, "fully constrained: {stderr}");
    let (code, stdout, stderr) =
        scene.run(&format!("{base} --max-marks 50 --save-correspondences @/used.csv"));
    assert_eq!(code, 0, "{stderr}");
    assert!(stdout.contains("50"), "{stdout}");
    assert_eq!(std::fs::read_to_string(scene.path("used.csv")).unwrap().lines().count(), 51);
    std::fs::write(scene.path("v.txt"), "4\n0 0\n100 7\n900 2000\n1500 1200\n").unwrap();
    let (code, _, stderr) = scene.run(&base.replace("dense.txt", "v.txt --vertices"));
    assert_eq!(code, 0, "{stderr}");
    let (code, _, stderr) =
        scene.run("transfer --template @/t.ply --target @/m.ply --frames @/f.npy --out @/o.glb");
    assert_eq!(code, 0, "{stderr}");
    assert!(stderr.contains("proposed"), "{stderr}");
    let proposed = std::fs::read_to_string(scene.path("o.correspondences.csv")).unwrap();
    assert!(proposed.starts_with("template,target\n") && proposed.lines().count() > 40);
}

#[test]
fn unusable_input_is_named_and_nothing_is_left() {
    let scene = Scene::new();
    let rest = scene.template.positions().to_vec();
    scene.frames("f.npy", std::slice::from_ref(&rest));
    npy::write(&scene.path("none.npy"), &[0, rest.len(), 3], &[]).unwrap();
    let mut hole = rest.clone();
    hole.iter_mut().for_each(|p| p[1] = f64::NAN);
    scene.frames("hole.npy", &[rest.clone(), rest.clone(), hole]);
    scene.frames("short.npy", &[rest[1..].to_vec()]);
    std::fs::write(scene.path("far.csv"), "0,0\n1,999999\n").unwrap();
    std::fs::write(scene.path("empty.csv"), "template,target\n").unwrap();
    std::fs::create_dir(scene.path("torn")).unwrap();
    write_mesh(&scene.path("torn/frame_0000.ply"), &scene.template).unwrap();
    let mut triangles = scene.template.triangles().to_vec();
    triangles[7].swap(0, 1);
    let other = TriangleMesh::new(rest.clone(), triangles).unwrap();
    write_mesh(&scene.path("torn/frame_0001.ply"), &other).unwrap();
    let collapsed = scene.template.triangles()[pair(&scene, 0)[0]];
    let mut flat = rest.clone();
    flat[collapsed[1] as usize] = flat[collapsed[0] as usize];
    let flat = scene.template.with_positions(flat).unwrap();
    write_mesh(&scene.path("flat.ply"), &flat).unwrap();
    let n = scene.target.positions().len() as u32;
    let twice: Vec<Vector> = scene
        .target
        .positions()
        .iter()
        .copied()
        .chain([[9.0, 0.0, 0.0], [9.0, 1.0, 0.0], [9.0, 0.0, 1.0]])
        .collect();
    let more = scene.target.triangles().iter().copied().chain([[n, n + 1, n + 2]]).collect();
    write_mesh(&scene.path("two.ply"), &TriangleMesh::new(twice, more).unwrap()).unwrap();
    std::fs::write(
        scene.path("cut.bvh"),
        "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n}\nMOTION\nFrames: 0\nFrame Time: 1\n",
    )
    .unwrap();
    std::fs::write(
        scene.path("bare.bvh"),
        "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n}\nMOTION\nFrames: 1\nFrame Time: 1\n0\n",
    )
    .unwrap();
    let before = std::fs::read_dir(scene.folder.path()).unwrap().count();
    let base = "transfer --template @/t.ply --target @/m.ply --correspondences @/c.csv --out @/new";
    for (change, to, part) in [
        ("c.csv", "far.csv", "line 2: second index 999999 is out of range"),
        ("c.csv", "empty.csv", "has no pairs"),
        ("m.ply", "two.ply", "1 component(s) of the target have no correspondence"),
        ("t.ply", "flat.ply", "zero area"),
        ("--out @/new", "--out @/new --frames @/short.npy", "shape"),
        ("--out @/new", "--out @/new --frames @/none.npy", "shape [0"),
        ("--out @/new", "--out @/new --frames @/hole.npy", "NaN or infinite"),
        ("--out @/new", "--out @/new --frames @/torn", "frame_0001.ply: has other triangles"),
        ("--out @/new", "--out @/new --frames @/cut.bvh", "has no frames"),
        ("--out @/new", "--out @/new --frames @/bare.bvh", "joint `a` has no CHANNELS"),
        ("--out @/new", "--out @/new --frames @/missing.npy", "missing.npy"),
        ("--out @/new", "--out @/new.fbx", ".glb"),
        ("--out @/new", "--out @/no/such/folder/a.glb", "cannot be written"),
        ("--out @/new", "--out @/new --sheet @/no/such.png", "cannot be written"),
    ] {
        let frames = if to.contains("--frames") { "" } else { " --frames @/f.npy" };
        let arguments = format!("{base}{frames}").replacen(change, to, 1);
        let (code, _, stderr) = scene.run(&arguments);
        assert_eq!(code, 1, "{to}: {stderr}");
        assert!(stderr.contains(part), "{to}: {stderr}");
        let after = std::fs::read_dir(scene.folder.path()).unwrap().count();
        assert_eq!(after, before, "{to}: something is left");
    }
    let (code, _, stderr) = scene.run("transfer --template @/t.ply --target @/m.ply --frames @/f.npy");
    assert!(code == 2 && stderr.contains("nothing to make"), "{stderr}");
    let (code, _, stderr) = scene.transfer("--out @/new"); // no motion
    assert!(code == 1 && stderr.contains("--frames"), "{stderr}");
    let loose = base.replace("m.ply", "two.ply") + " --frames @/f.npy --loose follow";
    assert_eq!(scene.run(&loose).0, 0);
}

/// The pair in line `k` of the correspondences.
fn pair(scene: &Scene, k: usize) -> [usize; 2] {
    let text = std::fs::read_to_string(scene.path("c.csv")).unwrap();
    let line = text.lines().nth(k + 1).unwrap();
    let mut numbers = line.split(',').map(|x| x.trim().parse().unwrap());
    [numbers.next().unwrap(), numbers.next().unwrap()]
}

/// A human skeleton in a T pose, y up, facing +z; `frame` gives degrees about x of left thigh, shin, upper arm and the
/// right ones, and about y of the hips.
fn bvh(frames: usize, frame: impl Fn(usize) -> [f64; 7]) -> String {
    let mut text = String::from(
        "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n",
    );
    let joint = |name: &str, offset: [f64; 3]| {
        let [x, y, z] = offset;
        format!("JOINT {name}\n{{\nOFFSET {x} {y} {z}\nCHANNELS 3 Zrotation Xrotation Yrotation\n")
    };
    let end = |x: f64, y: f64, z: f64| format!("End Site\n{{\nOFFSET {x} {y} {z}\n}}\n");
    for (side, s) in [("Left", 1.0), ("Right", -1.0)] {
        text += &joint(&format!("{side}UpLeg"), [s * 10.0, -5.0, 0.0]);
        text += &joint(&format!("{side}Leg"), [0.0, -42.0, 0.0]);
        text += &joint(&format!("{side}Foot"), [0.0, -42.0, 0.0]);
        text += &format!("{}}}\n}}\n}}\n", end(0.0, -6.0, 18.0));
    }
    text += &joint("Spine", [0.0, 12.0, 0.0]);
    text += &joint("Chest", [0.0, 20.0, 0.0]);
    for (side, s) in [("Left", 1.0), ("Right", -1.0)] {
        text += &joint(&format!("{side}Arm"), [s * 18.0, 20.0, 0.0]);
        text += &joint(&format!("{side}ForeArm"), [s * 30.0, 0.0, 0.0]);
        text += &joint(&format!("{side}Hand"), [s * 26.0, 0.0, 0.0]);
        text += &format!("{}}}\n}}\n}}\n", end(s * 18.0, 0.0, 0.0));
    }
    text += &joint("Head", [0.0, 28.0, 0.0]);
    text +=
        &format!("{}}}\n}}\n}}\n}}\nMOTION\nFrames: {frames}\nFrame Time: 0.0333333\n", end(0.0, 22.0, 0.0));
    for k in 0..frames {
        let [lt, ls, la, rt, rs, ra, turn] = frame(k);
        // Arms hang down by 70 degrees.
        let (legs, still) = (
            [[0.0, lt, 0.0], [0.0, ls, 0.0], [0.0; 3], [0.0, rt, 0.0], [0.0, rs, 0.0], [0.0; 3]],
            [[0.0; 3]; 2],
        );
        let arms = [[-70.0, la, 0.0], [0.0; 3], [0.0; 3], [70.0, ra, 0.0], [0.0; 3], [0.0; 3]];
        let hips = [[0.0, 95.0, k as f64 * 3.0], [0.0, 0.0, turn]];
        let numbers = [&hips[..], &legs, &still, &arms, &[[0.0; 3]]].concat();
        text += &numbers.as_flattened().iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        text.push('\n');
    }
    text
}

fn step(k: usize) -> [f64; 7] {
    let swing = 25.0 * (TAU * k as f64 / 30.0).sin();
    [-swing, swing.max(0.0), 0.8 * swing, swing, (-swing).max(0.0), -0.8 * swing, 0.0]
}

#[test]
fn a_noisy_skeleton_is_cleaned_and_moves_the_mesh() {
    let scene = Scene::new();
    std::fs::write(scene.path("clean.bvh"), bvh(60, step)).unwrap();
    // One wild frame, shake, and a whole turn in the description of the hips.
    let noisy = |k: usize| {
        let mut angles = step(k);
        angles.iter_mut().enumerate().for_each(|(i, a)| *a += 0.7 * ((k * k + 3 * i) as f64).sin());
        if k == 31 {
            angles.iter_mut().for_each(|a| *a += 150.0);
        }
        angles[6] += if k > 40 { 360.0 } else { 0.0 };
        angles
    };
    std::fs::write(scene.path("noisy.bvh"), bvh(60, noisy)).unwrap();
    let base = "retarget --mesh @/m.ply --motion";
    for (motion, cleaning, out) in [
        ("clean", "--lambda 0 --threshold 1e9", "a"),
        ("noisy", "", "b"),
        ("noisy", "--lambda 0 --threshold 1e9", "c"),
    ] {
        let (code, stdout, stderr) = scene
            .run(&format!("{base} @/{motion}.bvh {cleaning} --out @/{out}.npy --save-motion @/{out}.bvh"));
        assert_eq!(code, 0, "{stderr}");
        assert!(stdout.contains("second differences"), "{stdout}");
        assert_eq!(stdout.contains("5 frames: 30 to 34"), out == "b", "{stdout}");
    }
    let [clean, cleaned, raw] = ["a.npy", "b.npy", "c.npy"].map(|name| scene.read(name));
    assert_eq!(clean.len(), 60);
    let worst = |other: &Frames| {
        (0..60).map(|k| apart(&scene.target, clean.frame(k), other.frame(k))).fold(0.0, f64::max)
    };
    assert!(worst(&cleaned) < 0.06 && worst(&raw) > 0.3, "{} {}", worst(&cleaned), worst(&raw));
    // The figure walks along z, upright, its feet on the ground.
    let (first, last) = (clean.frame(0), clean.frame(59));
    let middle =
        |frame: &[Vector]| scale(1.0 / frame.len() as f64, frame.iter().fold([0.0; 3], |s, &p| add(s, p)));
    assert!(middle(last)[2] - middle(first)[2] > 1.0, "{:?} {:?}", middle(first), middle(last));
    for k in 0..60 {
        let low = clean.frame(k).iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
        let high = clean.frame(k).iter().map(|p| p[1]).fold(f64::NEG_INFINITY, f64::max);
        assert!(low > -0.1 && low < 0.25 && (1.4..1.8).contains(&high), "frame {k}: {low} {high}");
    }
    // Arms hang down although they stand off in the mesh: the figure is narrower than at rest.
    let width = |points: &[Vector]| points.iter().map(|p| p[0]).fold(0.0, f64::max);
    assert!(
        width(first) < 0.8 * width(scene.target.positions()),
        "{} {}",
        width(first),
        width(scene.target.positions())
    );
    // Angles alone, as a table, are the same motion.
    let text = std::fs::read_to_string(scene.path("clean.bvh")).unwrap();
    let rows: Vec<&str> = text.lines().skip_while(|line| !line.starts_with("Frame Time")).skip(1).collect();
    std::fs::write(scene.path("angles.csv"), rows.join("\n").replace(' ', ",")).unwrap();
    let (code, _, stderr) = scene
        .run(&format!("{base} @/angles.csv --skeleton @/clean.bvh --lambda 0 --threshold 1e9 --out @/d.npy"));
    assert_eq!(code, 0, "{stderr}");
    assert_eq!(scene.read("d.npy"), clean);
    // And as a template, the figure drives another one.
    let (code, _, stderr) = scene.run(
        "transfer --template @/t.ply --frames @/clean.bvh --target @/m.ply --correspondences @/c.csv --every 20 --in-place \
         --save-joints @/j.csv --out @/e.npy",
    );
    assert_eq!(code, 0, "{stderr}");
    assert_eq!(scene.read("e.npy").len(), 3);
    let (code, _, stderr) =
        scene.run("retarget --mesh @/t.ply --motion @/clean.bvh --joints @/j.csv --out @/f --every 30");
    assert_eq!(code, 0, "{stderr}");
}

#[test]
fn skeletons_that_do_not_fit_say_what_to_do() {
    let scene = Scene::new();
    std::fs::write(scene.path("a.bvh"), bvh(12, step)).unwrap();
    std::fs::write(scene.path("a.csv"), "1,2,3\n").unwrap();
    std::fs::write(scene.path("wild.bvh"), bvh(12, |k| [90.0 * (k * k) as f64; 7])).unwrap();
    let base = "--out @/x.npy";
    for (arguments, part) in [
        (format!("retarget --mesh sphere:2 --motion @/a.bvh {base}"), "--joints"),
        (format!("retarget --mesh @/m.ply --motion @/a.csv {base}"), "--skeleton"),
        (format!("retarget --mesh @/m.ply --motion @/a.csv --skeleton @/a.bvh {base}"), "51 channels"),
        (format!("retarget --mesh @/m.ply --motion @/wild.bvh --threshold 1 {base}"), "raise the threshold"),
        (format!("retarget --mesh @/m.ply --motion @/a.bvh --backend nobody {base}"), "no backend"),
    ] {
        let (code, _, stderr) = scene.run(&arguments);
        assert_eq!(code, 1, "{arguments}: {stderr}");
        assert!(stderr.contains(part), "{arguments}: {stderr}");
        assert!(!Path::exists(&scene.path("x.npy")));
    }
}
