"""Generate Python messages from .msg definitions with ROS's wheels, and compile them; run by `make interop`.

Run in an environment with the wheels: generate_msgs.py FOLDER, where FOLDER has PACKAGE/msg/NAME.msg. The command
`rosidl` of the wheels refuses its own plug-ins, because the wheels list each of them twice; so they are called here.
"""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from shutil import copy, rmtree
from tempfile import TemporaryDirectory

import numpy
from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_generator_c.cli import GenerateC
from rosidl_generator_py.cli import GeneratePython
from rosidl_generator_type_description.cli import HashTypeDescription
from rosidl_typesupport_c.cli import GenerateCTypesupport as DispatchingTypesupport
from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport as FastTypesupport
from rosidl_typesupport_introspection_c.cli import (
    GenerateIntrospectionCTypesupport as IntrospectionTypesupport,
)

PREFIX = Path(sys.prefix)
SITE = Path(sysconfig.get_paths()["purelib"])
INCLUDE_PATHS = [str(PREFIX / "share")]
ENTRY_POINT = "rosidl_typesupport_c"
IMPLEMENTATIONS = ["rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"]


def libraries():
    """What generated code is linked with: the messages of the wheels and ROS's run time."""
    kinds = ("rosidl_generator_c", "rosidl_generator_py", ENTRY_POINT, *IMPLEMENTATIONS)
    names = [
        f"{package}__{kind}"
        for package in ("std_msgs", "geometry_msgs", "builtin_interfaces")
        for kind in kinds
    ]
    return [*names, "rosidl_runtime_c", "rosidl_typesupport_c", *IMPLEMENTATIONS, "fastcdr", "rcutils"]


def generated(package, out):
    """Write IDL, C and Python of a package, as its build would."""
    messages = sorted(path.relative_to(package) for path in package.glob("msg/*.msg"))
    for message in messages:
        convert_msg_to_idl(package, package.name, message, out / "msg")
    idl = [f"{out}:{message.with_suffix('.idl')}" for message in messages]
    arguments = {"package_name": package.name, "include_paths": INCLUDE_PATHS, "output_path": out}
    described = HashTypeDescription("hash").generate_type_hashes(interface_files=idl, **arguments)
    GenerateC("c").generate(interface_files=idl, type_description_files=described, **arguments)
    for generator in (
        FastTypesupport("fastrtps_c"),
        IntrospectionTypesupport("introspection_c"),
        DispatchingTypesupport("c", typesupport_implementations=IMPLEMENTATIONS),
        GeneratePython("py", typesupport_implementations=[ENTRY_POINT]),
    ):
        generator.generate(interface_files=idl, **arguments)


def compiled(package, out):
    """Compile everything of a package into its one Python extension."""
    includes = [str(out.parent), sysconfig.get_paths()["include"], numpy.get_include()]
    headers = PREFIX / "include"
    includes += [str(headers), *map(str, headers.iterdir())]
    flags = ["-O1", "-fPIC", "-w", *(f"-I{path}" for path in includes)]
    objects = []
    for source in sorted([*out.rglob("*.c"), *out.rglob("*.cpp")]):
        language = ["gcc"] if source.suffix == ".c" else ["g++", "-std=c++17"]
        objects.append(f"{source}.o")
        subprocess.run([*language, *flags, "-c", str(source), "-o", objects[-1]], check=True)
    library_folder = PREFIX / "lib"
    links = [f"-L{library_folder}", f"-Wl,-rpath,{library_folder}", *(f"-l{name}" for name in libraries())]
    extension = out / f"{package}_s__{ENTRY_POINT}.so"
    subprocess.run(["g++", "-shared", "-o", str(extension), *objects, *links], check=True)


def main(folder):
    os.environ["AMENT_PREFIX_PATH"] = str(PREFIX)
    for package in sorted(Path(folder).resolve().iterdir()):
        with TemporaryDirectory() as temporary:
            out = Path(temporary) / package.name
            out.mkdir()
            generated(package, out)
            compiled(package.name, out)
            installed = SITE / package.name
            rmtree(installed, ignore_errors=True)
            (installed / "msg").mkdir(parents=True)
            (installed / "__init__.py").touch()
            for path in (*out.glob("*.so"), *out.glob("msg/*.py")):
                copy(path, installed / path.relative_to(out))
            for implementation in IMPLEMENTATIONS:  # which the run time loads by these names
                library = PREFIX / "lib" / f"lib{package.name}__{implementation}.so"
                library.unlink(missing_ok=True)
                library.symlink_to(installed / f"{package.name}_s__{ENTRY_POINT}.so")


if __name__ == "__main__":
    main(sys.argv[1])
