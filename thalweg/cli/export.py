"""`thalweg export`: writes a policy as one ONNX file."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from thalweg.cli.command import Command
from thalweg.cli.flight_options import policy_name
from thalweg.cli.options import Plugins, check_file


@dataclass(frozen=True)
class Export(Command):
    """Write a policy as one ONNX file with its encoder, memory, preprocessing and choice of actions."""

    policy: Positional[str] = "packaged"
    """A run's folder, a policy file, `packaged`, or `packaged-rgb`."""
    out: Path = Path("policy.onnx")
    """File to write, .onnx; an existing one is replaced."""
    encoder: str | None = None
    """Encoder's file, the folder of its training or a packaged one; by default that of the policy's training."""
    plugin: Plugins = ()

    def run(self) -> int:
        from thalweg.bench.packaged import policy_path
        from thalweg.cli.evaluate import load_named_policy
        from thalweg.deploy.export import export_policy
        from thalweg.train.river import load_compatible_encoder
        from thalweg.train.run_in_folder import policy_file

        check_file("--out", self.out, ".onnx")
        policy = load_named_policy(self.policy, trained=True)
        encoder = None if self.encoder is None else load_compatible_encoder(self.encoder)
        path = policy_path(self.policy)
        source = policy_file(path) if path.exists() else None
        about = export_policy(policy, self.out, encoder=encoder, source=source, name=policy_name(self.policy))
        camera = about["camera"]
        lens = f" behind a {camera['lens']['model']} lens" if "lens" in camera else ""
        print(
            f"{self.out}: {self.out.stat().st_size / 1e6:.1f} MB; takes {', '.join(about['inputs'])} of"
            f" {camera['height_px']} x {camera['width_px']} pixels, {camera['fov_deg']:g} degrees{lens};"
            " acts as the policy does"
        )
        return 0
