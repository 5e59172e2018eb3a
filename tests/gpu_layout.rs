//! The kernels' WGSL text and the Rust that drives it agree: structs, bindings, constants. Needs no adapter.
#![cfg(feature = "gpu")]

use std::mem::offset_of;

use wgpu::naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use wgpu::naga::{AddressSpace, Expression, Literal, Module, TypeInner, front::wgsl};
use wildwood::canopy::crowns::{MAX_RADIUS_UNITS, UNITS_PER_CELL};
use wildwood::canopy::visibility_gpu::{Band, Crown, Tally, WGSL};
use wildwood::export::render::camera::NEAR_M;
use wildwood::export::render::camera_gpu::View;
use wildwood::export::render::draw_list_gpu::ItemRecord;
use wildwood::export::render::foliage::{LUMP_TILT, MOST_LEAVES};
use wildwood::export::render::ground_mesh::PATCH_CELLS;
use wildwood::export::render::models_gpu::{ModelCorner, Triangle, surface_code};
use wildwood::export::render::picture_gpu::{
    FOLIAGE_WGSL, GROUND_WGSL, PatchRecord, SHADOW_WGSL, SPLAT_WGSL, STREW_WGSL, SplatRecord,
    TuftRecord,
};
use wildwood::tree::mesh::Material;

/// Name, offset and size in bytes of a field.
type Field = (String, usize, usize);

/// A struct's name in the text, its fields, and its size.
type NamedStruct = (&'static str, (Vec<Field>, usize));

fn parse(text: &str) -> Module {
    wgsl::parse_str(text).unwrap_or_else(|error| panic!("{}", error.emit_to_string(text)))
}

/// Fields of a struct of the text, and its size.
fn wgsl_struct(module: &Module, name: &str) -> (Vec<Field>, usize) {
    let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name));
    let Some((_, ty)) = found else { panic!("the text has no struct {name}") };
    let TypeInner::Struct { members, span } = &ty.inner else { panic!("{name} is no struct") };
    let fields = members.iter().map(|member| {
        let bytes = module.types[member.ty].inner.size(module.to_ctx());
        (member.name.clone().unwrap_or_default(), member.offset as usize, bytes as usize)
    });
    (fields.collect(), *span as usize)
}

/// Fields of a Rust struct, and its size.
macro_rules! rust_struct {
    ($name:ident { $($field:ident: $of:ty),* }) => {{
        // a field too few or of another type does not compile
        let $name { $($field),* } = $name::default();
        $(let _: $of = $field;)*
        let fields: Vec<Field> = vec![
            $((stringify!($field).to_owned(), offset_of!($name, $field), size_of::<$of>())),*
        ];
        (fields, size_of::<$name>())
    }};
}

fn structs() -> [NamedStruct; 3] {
    [
        ("Band", rust_struct!(Band { first_row: u32, rows: u32, cols: u32, crowns: u32 })),
        ("Crown", rust_struct!(Crown { x: i32, y: i32, radius: i32, center_z: i32 })),
        (
            "Tally",
            rust_struct!(Tally {
                visible_cells: u32,
                canopy_cells: u32,
                sum_cols: i32,
                sum_rows: i32
            }),
        ),
    ]
}

/// Names of structs that differ between the text and Rust.
fn drifted(text: &str) -> Vec<&'static str> {
    let module = parse(text);
    let all = structs().into_iter();
    all.filter(|(name, rust)| wgsl_struct(&module, name) != *rust).map(|(name, _)| name).collect()
}

fn constant(module: &Module, name: &str) -> i64 {
    let found = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name));
    let Some((_, constant)) = found else { panic!("the text has no constant {name}") };
    match module.global_expressions[constant.init] {
        Expression::Literal(Literal::I32(value)) => i64::from(value),
        Expression::Literal(Literal::U32(value)) => i64::from(value),
        ref other => panic!("{name} is {other:?}"),
    }
}

#[test]
fn structs_have_the_same_fields_at_the_same_offsets() {
    assert_eq!(drifted(WGSL), [""; 0]);
}

#[test]
fn planted_drift_is_caught() {
    let swapped =
        WGSL.replace("    x: i32,", "    swap: i32,").replace("    y: i32,", "    x: i32,");
    assert_eq!(drifted(&swapped.replace("    swap: i32,", "    y: i32,")), ["Crown"]);
    assert_eq!(
        drifted(&WGSL.replace("    rows: u32,", "    more: u32,\n    rows: u32,")),
        ["Band"]
    );
    let longer = WGSL.replace("    sum_rows: i32,", "    sum_rows: i32,\n    more: u32,");
    assert_eq!(drifted(&longer), ["Tally"]);
}

#[test]
fn bindings_are_numbered_as_they_are_given() {
    let module = parse(WGSL);
    let bound: Vec<(u32, u32, &str)> = module
        .global_variables
        .iter()
        .filter_map(|(_, variable)| {
            let binding = variable.binding.as_ref()?;
            Some((binding.group, binding.binding, variable.name.as_deref().unwrap_or("")))
        })
        .collect();
    let wanted = ["band", "crowns", "depth", "owner", "is_canopy", "tallies"];
    let wanted: Vec<_> = (0..).zip(wanted).map(|(number, name)| (0, number, name)).collect();
    assert_eq!(bound, wanted);
}

#[test]
fn constants_follow_the_cpu() {
    let module = parse(WGSL);
    assert_eq!(1 << constant(&module, "CELL_SHIFT"), i64::from(UNITS_PER_CELL));
    assert_eq!(2 * constant(&module, "HALF_CELL"), i64::from(UNITS_PER_CELL));
    // whole_root is right for squares below 2²²
    assert!(MAX_RADIUS_UNITS.pow(2) < 1 << 22);
}

/// Storage buffers that an entry point uses.
fn storage_buffers(module: &Module, info: &ModuleInfo, entry_point: usize) -> usize {
    let uses = info.get_entry_point(entry_point);
    let used = module.global_variables.iter().filter(|(handle, variable)| {
        matches!(variable.space, AddressSpace::Storage { .. }) && !uses[*handle].is_empty()
    });
    used.count()
}

#[test]
fn every_adapter_can_bind_what_a_kernel_uses() {
    let module = parse(WGSL);
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(WGSL)));
    let limits = wgpu::Limits::downlevel_defaults();
    for (index, entry_point) in module.entry_points.iter().enumerate() {
        let used = storage_buffers(&module, &info, index);
        let name = &entry_point.name;
        assert!(used <= limits.max_storage_buffers_per_shader_stage as usize, "{name}: {used}");
        let lanes: u32 = entry_point.workgroup_size.iter().product();
        assert!(lanes <= limits.max_compute_invocations_per_workgroup, "{name}: {lanes} lanes");
    }
}

/// The texts that draw pictures, with the structs of each but for the camera's.
fn picture_texts() -> [(&'static str, Vec<NamedStruct>); 5] {
    let item = rust_struct!(ItemRecord {
        position: [f32; 3],
        place: u32,
        axis_x: [f32; 3],
        seed: u32,
        axis_y: [f32; 3],
        leaf_m: f32,
        axis_z: [f32; 3],
        fringe_m: f32,
        lump_m: f32,
        lump_reach_m: f32,
        inset_m: f32,
        cover: f32,
        width: f32,
        droop: f32,
        lumpiness: f32,
        is_leafy: u32
    });
    let corner =
        rust_struct!(ModelCorner { position: [f32; 3], pad_a: u32, normal: [f32; 3], pad_b: u32 });
    let triangle = rust_struct!(Triangle { corners: [u32; 3], number_and_surface: u32 });
    let models = vec![("Item", item), ("ModelCorner", corner), ("Triangle", triangle)];
    let splat = rust_struct!(SplatRecord {
        middle_px: [f32; 2],
        size_px: [f32; 2],
        nearness: f32,
        area_px: f32,
        place: u32,
        word: u32
    });
    let patch = rust_struct!(PatchRecord { row: u32, col: u32, step: u32, pad: u32 });
    let tuft = rust_struct!(TuftRecord { col: i32, row: i32, px_per_m: f32, counts: u32 });
    [
        (FOLIAGE_WGSL, models.clone()),
        (SHADOW_WGSL, models),
        (SPLAT_WGSL, vec![("Splat", splat)]),
        (GROUND_WGSL, vec![("Patch", patch)]),
        (STREW_WGSL, vec![("Tuft", tuft)]),
    ]
}

#[test]
fn structs_of_pictures_have_the_same_fields_at_the_same_offsets() {
    let view = rust_struct!(View {
        eye: [f32; 3],
        px_per_m: f32,
        right: [f32; 3],
        depth_base: f32,
        up: [f32; 3],
        depth_scale: f32,
        forward: [f32; 3],
        is_perspective: u32,
        size_px: [f32; 2],
        window_px: [f32; 2],
        window_size_px: [f32; 2],
        gap_m: f32,
        gap_threshold: f32,
        edges_m: [f32; 4],
        ground_cols: u32,
        ground_rows: u32,
        ground_cell_m: f32,
        base_m: f32,
        has_walls: u32,
        needs_all_corners: u32,
        pad_a: u32,
        pad_b: u32
    });
    for (text, structs) in picture_texts() {
        let module = parse(text);
        for (name, rust) in structs.iter().chain([&("View", view.clone())]) {
            assert_eq!(wgsl_struct(&module, name), *rust, "{name}");
        }
    }
}

#[test]
fn constants_of_pictures_follow_the_cpu() {
    let foliage = parse(FOLIAGE_WGSL);
    assert_eq!(number(&foliage, "NEAR_M"), NEAR_M);
    assert_eq!(number(&foliage, "MOST_LEAVES"), MOST_LEAVES);
    assert_eq!(number(&foliage, "LUMP_TILT"), LUMP_TILT);
    assert_eq!(constant(&foliage, "FOLIAGE"), i64::from(surface_code(Material::Foliage)));
    assert_eq!(constant(&parse(GROUND_WGSL), "PATCH_CELLS"), PATCH_CELLS as i64);
}

fn number(module: &Module, name: &str) -> f32 {
    let found = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name));
    let Some((_, constant)) = found else { panic!("the text has no constant {name}") };
    match module.global_expressions[constant.init] {
        Expression::Literal(Literal::F32(value)) => value,
        ref other => panic!("{name} is {other:?}"),
    }
}

#[test]
fn every_adapter_can_bind_what_a_pipeline_uses() {
    let limits = wgpu::Limits::downlevel_defaults();
    for (text, _) in picture_texts() {
        let module = parse(text);
        let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
            .validate(&module)
            .unwrap_or_else(|error| panic!("{}", error.emit_to_string(text)));
        for (index, entry_point) in module.entry_points.iter().enumerate() {
            let used = storage_buffers(&module, &info, index);
            let name = &entry_point.name;
            assert!(used <= limits.max_storage_buffers_per_shader_stage as usize, "{name}: {used}");
            let is_fragment = entry_point.stage == wgpu::naga::ShaderStage::Fragment;
            assert!(!is_fragment || used == 0, "{name}: fragments are given no storage");
        }
    }
}
