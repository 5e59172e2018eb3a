//! Pictures from the command line: bad input gets one clear error and leaves nothing behind; good input gives the same file for any
//! number of threads.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use wildwood::gpu::adapters;

fn wildwood(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_wildwood")).args(arguments).output().unwrap()
}

fn render(folder: &Path, output: &Path, options: &[&str]) -> Output {
    let mut arguments =
        vec!["render", folder.to_str().unwrap(), "-o", output.to_str().unwrap(), "--quiet"];
    arguments.extend(options);
    wildwood(&arguments)
}

#[test]
fn views_are_drawn_and_bad_input_is_told() {
    let home = tempfile::tempdir().unwrap();
    let scene = home.path().join("forest");
    let made = wildwood(&[
        "demo",
        "--no-pictures",
        "-o",
        scene.to_str().unwrap(),
        "--size",
        "96",
        "--quiet",
    ]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let out = home.path().join("view.png");

    let size = ["--size", "96x64"];
    for view in ["overview", "forest-floor", "profile", "map"] {
        let mut files = Vec::new();
        for threads in ["1", "2"] {
            let options = [&size[..], &["--view", view, "--threads", threads]].concat();
            let done = render(&scene, &out, &options);
            assert!(done.status.success(), "{view}: {}", String::from_utf8_lossy(&done.stderr));
            files.push(fs::read(&out).unwrap());
            fs::remove_file(&out).unwrap();
        }
        assert!(files[0] == files[1], "{view} differs between one thread and two");
        let picture = image::load_from_memory(&files[0]).unwrap();
        assert_eq!((picture.width(), picture.height()), (96, 64));
    }

    let cases: [(&[&str], &str); 12] = [
        (&["--size", "0x64"], "--size"),
        (&["--size", "96"], "1280x720"),
        (&["--size", "8192x8192", "--samples", "4"], "fewer samples"),
        (&["--camera", "1,2,3"], "--camera"),
        (&["--camera", "1,2,3,0,-95"], "pitch"),
        (&["--camera", "1,2,3", "--look-at", "1,2,3"], "--look-at"),
        (&["--sun", "90,-5"], "--sun"),
        (&["--season", "monsoon"], "autumn"),
        (&["--colour", "hue"], "vigor"),
        (&["--bbox", "-900,-900,-800,-800"], "--bbox"),
        (&["--turntable", "3", "--view", "map"], "--turntable"),
        (&["--gpu", "cuda"], "none of auto, off, require"),
    ];
    for (options, told) in cases {
        let done = render(&scene, &out, options);
        let text = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(2), "{options:?}: {text}");
        assert!(text.contains(told) && !text.contains("panicked"), "{options:?}: {text}");
    }
    if adapters().iter().all(|adapter| adapter.is_software) {
        let done = render(&scene, &out, &[&size[..], &["--gpu", "require"]].concat());
        let text = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(1), "{text}");
        let told = text.lines().filter(|line| line.contains("a GPU is required")).count();
        assert!(told == 1 && text.contains("--gpu auto"), "{text}");
        assert!(!text.contains("panicked") && !out.exists(), "{text}");
    }
    let jpeg = render(&scene, &home.path().join("view.jpg"), &size);
    assert!(String::from_utf8_lossy(&jpeg.stderr).contains(".png"));
    let nowhere = render(&home.path().join("nothing"), &out, &size);
    assert_eq!(nowhere.status.code(), Some(2));
    let mut left: Vec<_> =
        fs::read_dir(home.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["forest"], "nothing but the scene is left");

    let turned = render(&scene, &out, &["--size", "64x48", "--turntable", "2", "--samples", "1"]);
    assert!(turned.status.success(), "{}", String::from_utf8_lossy(&turned.stderr));
    assert!(home.path().join("view_000.png").exists() && home.path().join("view_001.png").exists());
}
