"""FMI 2 unit compiled from C: ẍ + cẋ + (d + e cos t)x = f cos t + u with the input u."""

import shutil
import subprocess
import sys
import zipfile

import casadi
import pytest

NUMBERS = {"c": 0.2, "d": 1.6, "e": 0.5, "f": 0.3}
STUBS = [
    "GetTypesPlatform",
    "SetDebugLogging",
    "Reset",
    "GetInteger",
    "GetBoolean",
    "GetString",
    "SetInteger",
    "SetBoolean",
    "SetString",
    "GetFMUstate",
    "SetFMUstate",
    "FreeFMUstate",
    "SerializedFMUstateSize",
    "SerializeFMUstate",
    "DeSerializeFMUstate",
    "CompletedIntegratorStep",
    "EnterEventMode",
    "GetNominalsOfContinuousStates",
    "EnterInitializationMode",
    "ExitInitializationMode",
    "EnterContinuousTimeMode",
    "SetupExperiment",
    "Terminate",
    "FreeInstance",
]
SOURCE = """
#include <math.h>
#include <string.h>
typedef struct { int a, b, c, d, e; double next; } Event;
static double v[8], t;  /* x, v, u, c, d, e, f, output */
static double rate(int r) {
    return r == 10 ? v[1] : v[2] + v[6] * cos(t) - v[3] * v[1] - (v[4] + v[5] * cos(t)) * v[0];
}
static double partial(int r, int k) {
    if (r == 7) return k == 0 ? 2.0 : 0.0;
    if (r == 10) return k == 1;
    return k == 0 ? -(v[4] + v[5] * cos(t)) : k == 1 ? -v[3] : 1.0;
}
void *fmi2Instantiate() { double w[8] = {START}; memcpy(v, w, sizeof v); t = 0; return v; }
const char *fmi2GetVersion() { return "2.0"; }
int fmi2SetReal(void *m, const unsigned *r, size_t n, const double *x) {
    for (size_t k = 0; k < n; k++) v[r[k]] = x[k];
    return 0;
}
int fmi2GetReal(void *m, const unsigned *r, size_t n, double *x) {
    for (size_t k = 0; k < n; k++) x[k] = r[k] == 7 ? 2 * v[0] : v[r[k]];
    return 0;
}
int fmi2NewDiscreteStates(void *m, Event *event) {
    memset(event, 0, sizeof *event);
    event->e = NEXT > 0; event->next = NEXT;
    return 0;
}
int fmi2SetTime(void *m, double time) { t = time; return 0; }
int fmi2SetContinuousStates(void *m, const double *x, size_t n) { v[0] = x[0]; v[1] = x[1]; return 0; }
int fmi2GetContinuousStates(void *m, double *x, size_t n) { x[0] = v[0]; x[1] = v[1]; return 0; }
int fmi2GetDerivatives(void *m, double *x, size_t n) { x[0] = rate(10); x[1] = rate(11); return 0; }
int fmi2GetEventIndicators(void *m, double *z, size_t n) { z[0] = SWITCH; return 0; }
int fmi2GetDirectionalDerivative(void *m, const unsigned *r, size_t n, const unsigned *k, size_t j,
                                 const double *seed, double *x) {
    for (size_t a = 0; a < n; a++) {
        x[a] = 0;
        for (size_t b = 0; b < j; b++) x[a] += partial(r[a], k[b]) * seed[b];
    }
    return PARTIAL;
}
"""
STATE = 'causality="local" variability="continuous" initial="exact"'
PARAMETER = 'causality="parameter" variability="tunable"'
VARIABLES = [
    ("x", 0, STATE, 'start="0.1"'),
    ("v", 1, STATE, 'start="0"'),
    ("u", 2, 'causality="input"', 'start="0"'),
    *[(name, 3 + k, PARAMETER, f'start="{value}"') for k, (name, value) in enumerate(NUMBERS.items())],
    ("y", 7, 'causality="output"', ""),
    ("der(x)", 10, 'causality="local"', 'derivative="1"'),
    ("der(v)", 11, 'causality="local"', 'derivative="2"'),
]
HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="mathieu" guid="1" description="Hill"
 numberOfEventIndicators="1">
<KIND modelIdentifier="mathieu" providesDirectionalDerivative="true"/>
<UnitDefinitions><Unit name="m"/></UnitDefinitions>
"""
TAIL = """<ModelStructure><Outputs><Unknown index="8"/></Outputs>
<Derivatives><Unknown index="9"/><Unknown index="10"/></Derivatives></ModelStructure>
</fmiModelDescription>"""


def require_fmu_tools(exported=True):
    """Skip a test without FMPy, without a C compiler or, for exported units, without CasADi 3.8."""
    pytest.importorskip("fmpy", reason="FMPy is not installed")
    if sys.platform == "win32" or shutil.which("cc") is None:
        pytest.skip("there is no C compiler")
    if exported and not hasattr(casadi.DaeBuilder, "compile_fmu"):
        pytest.skip("CasADi is older than 3.8")


def description(kind="ModelExchange"):
    rows = [
        f'<ScalarVariable name="{name}" valueReference="{number}" description="the {name}" {causality}>'
        f'<Real unit="m" {rest}/></ScalarVariable>\n'
        for name, number, causality, rest in VARIABLES
    ]
    return f"{HEAD.replace('KIND', kind)}<ModelVariables>{''.join(rows)}</ModelVariables>{TAIL}"


def write_unit(folder, *, next_event="0", indicator="1", status="0", kind="ModelExchange", stubs=STUBS):
    """Return the path of the unit. `indicator` is a C expression, and `status` the return status of the
    directional derivatives."""
    start = ", ".join(["0.1", "0", "0", *map(repr, NUMBERS.values()), "0"])
    source = SOURCE.replace("START", start).replace("NEXT", next_event).replace("SWITCH", indicator)
    source = source.replace("PARTIAL", status) + "".join(
        f"int fmi2{name}() {{ return 0; }}\n" for name in stubs
    )
    platform = {"linux": ("linux64", ".so"), "darwin": ("darwin64", ".dylib")}[sys.platform]
    (folder / "mathieu.c").write_text(source)
    library = folder / f"mathieu{platform[1]}"
    subprocess.run(
        ["cc", "-shared", "-fPIC", "-w", "mathieu.c", "-o", library, "-lm"], cwd=folder, check=True
    )
    with zipfile.ZipFile(folder / "mathieu.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", description(kind))
        archive.write(library, f"binaries/{platform[0]}/{library.name}")
    return folder / "mathieu.fmu"
