fn main() {
    let c = shaderc::Compiler::new();
    let _ = c.is_ok();
}
