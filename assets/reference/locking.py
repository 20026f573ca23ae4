"""Reference values for crates/oracle/src/tests/locking.rs, which tests that tetrahedra do not lock (become much too stiff)
near incompressibility: two bodies in linear elastostatics, meshed with quadratic tetrahedra (scikit-fem's ElementTetP2).

    python3 assets/reference/locking.py > assets/reference/locking.csv      (a few minutes; pip install scikit-fem==12.0.2)

Young's modulus is 1 Pa. By symmetry a quarter of the cantilever and an eighth of the block are meshed, with smaller cells
towards the edges of the faces whose displacement is prescribed. The cantilever is a bar of 1 x 0.2 x 0.2 m, held at x = 0,
with 1 N along -y spread evenly over its end x = 1; quantity `cantilever`: mean deflection of this end along -y, m. The block
is a cube of 0.1 m, held at y = 0, whose face y = 0.1 is moved by -0.01 m along y without slip; quantity `force`: force on
the moved face, N; quantity `bulge`: mean outward displacement of the sides normal to x, m. Column `value`: the quantity with
n = 8 cells along each edge of the meshed part (3 n along the bar's length); column `coarser`: the quantity with n = 6,
which shows how far `value` is from convergence.
"""

import numpy as np
from scipy.sparse.linalg import splu
from skfem import Basis, ElementTetP2, ElementVector, FacetBasis, LinearForm, MeshTet
from skfem.models.elasticity import lame_parameters, linear_elasticity


def at(axis, value):
    return lambda x: np.isclose(x[axis], value)


def graded(cells, lengths):
    """A box with a corner at the origin. Along axes of negative length cells are smaller near the origin, else far from it."""
    mesh = MeshTet.init_tensor(*(np.linspace(0, 1, n + 1) for n in cells))
    place = lambda s, l: -l * s**2 if l < 0 else l * (1 - (1 - s) ** 2)
    return MeshTet(np.stack([place(s, l) for s, l in zip(mesh.p, lengths)]), mesh.t)


def solve(mesh, poisson, held, load=None, moved=None, mean=None):
    """Solves for the displacements u, m; returns twice the strain energy, J, and the integral asked for by `mean`, m^3.

    held: pairs of a face and the axes along which u is zero there; load: face, axis and traction, Pa; moved: face, axis and
    displacement, m; mean: the face to integrate over, and the axis of the component of u that is integrated.
    """
    element = ElementVector(ElementTetP2())
    basis = Basis(mesh, element)
    k = linear_elasticity(*lame_parameters(1.0, poisson)).assemble(basis).tocsc()
    over = lambda face, axis: LinearForm(lambda v, w: v[axis]).assemble(
        FacetBasis(mesh, element, facets=mesh.facets_satisfying(face, boundaries_only=True))
    )
    dofs = lambda face, axes: basis.get_dofs(face).all([f"u^{a + 1}" for a in axes])
    u, f = np.zeros(k.shape[0]), np.zeros(k.shape[0])
    known = [dofs(face, axes) for face, axes in held]
    if moved:
        known.append(dofs(moved[0], [moved[1]]))
        u[known[-1]] = moved[2]
    if load:
        f = load[2] * over(load[0], load[1])
    known = np.unique(np.concatenate(known))
    free = np.setdiff1d(np.arange(len(u)), known)
    lu = splu(k[free][:, free], "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    u[free] = lu.solve(f[free] - k[free][:, known] @ u[known])
    return u @ (k @ u), over(*mean) @ u if mean else None


def cantilever(poisson, n):
    # A quarter of the bar: u is antisymmetric about the plane y = 0 and symmetric about the plane z = 0.
    held = [(at(0, 0), [0, 1, 2]), (at(1, 0), [0, 2]), (at(2, 0), [2])]
    energy, _ = solve(graded((3 * n, n, n), (-1.0, 0.1, 0.1)), poisson, held, load=(at(0, 1), 1, -25.0))
    return {"cantilever": 4 * energy}


def block(poisson, n):
    # An eighth of the cube: u is symmetric about all three middle planes.
    held = [(at(0, 0), [0]), (at(1, 0), [1]), (at(2, 0), [2]), (at(1, 0.05), [0, 2])]
    moved = (at(1, 0.05), 1, -0.005)
    energy, bulge = solve(graded((n, n, n), (0.05, 0.05, 0.05)), poisson, held, moved=moved, mean=(at(0, 0.05), 0))
    return {"force": 8 * energy / 0.01, "bulge": bulge / 0.0025}


print("poisson,quantity,value,coarser")
for poisson in (0.3, 0.45, 0.49, 0.499):
    for case in (cantilever, block):
        coarser = case(poisson, 6)
        for name, value in case(poisson, 8).items():
            print(f"{poisson},{name},{value:.6e},{coarser[name]:.6e}", flush=True)
