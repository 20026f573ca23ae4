"""Reference values for crates/oracle/src/laws/locking.rs: linear elastostatics, quadratic tetrahedra (scikit-fem's ElementTetP2).

    python3 assets/reference/locking.py > assets/reference/locking.csv      (a few minutes; pip install scikit-fem==12.0.2)

Young's modulus 1 Pa. By symmetry a part of each body stands for it; meshes are finer towards edges where what is held ends.
cantilever: 1 x 0.2 x 0.2 m, x = 0 held, 1 N along -y spread evenly over x = 1. value: mean deflection of that face, m.
block: 0.1 m cube, y = 0 held, y = 0.1 moved by -0.01 m, both without slip. force, N; bulge: mean outward displacement of the
sides along x, m. coarser: the same value with 6 instead of 8 cells a side, which tells how far it still is from convergence.
"""

import numpy as np
from scipy.sparse.linalg import splu
from skfem import Basis, ElementTetP2, ElementVector, FacetBasis, LinearForm, MeshTet
from skfem.models.elasticity import lame_parameters, linear_elasticity


def at(axis, value):
    return lambda x: np.isclose(x[axis], value)


def graded(cells, lengths):
    """A box from the origin; a negative length is graded towards the origin, a positive one away from it."""
    mesh = MeshTet.init_tensor(*(np.linspace(0, 1, n + 1) for n in cells))
    place = lambda s, l: -l * s**2 if l < 0 else l * (1 - (1 - s) ** 2)
    return MeshTet(np.stack([place(s, l) for s, l in zip(mesh.p, lengths)]), mesh.t)


def solve(mesh, poisson, held, load=None, moved=None, mean=None):
    """Displacements' energy times two, and the integral of a component over a face."""
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
    # A quarter: antisymmetric about y = 0, symmetric about z = 0.
    held = [(at(0, 0), [0, 1, 2]), (at(1, 0), [0, 2]), (at(2, 0), [2])]
    energy, _ = solve(graded((3 * n, n, n), (-1.0, 0.1, 0.1)), poisson, held, load=(at(0, 1), 1, -25.0))
    return {"cantilever": 4 * energy}


def block(poisson, n):
    # An eighth: symmetric about all three middle planes.
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
