"""The paper's Phong lobe (eq. 1) for Mitsuba: not normalised, no cosine on the lobe.

A lamp of perpendicular irradiance E then gives E/π · (ρ_d (l·n) + ρ_s (l·r)^α).
Import after a Mitsuba variant was set.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi


class Phong(mi.BSDF):
    """Textures `albedo` (RGB), `rho_s` and `alpha`; sampled half by cosine, half by its lobe."""

    def __init__(self, props: mi.Properties):
        mi.BSDF.__init__(self, props)
        self.albedo, self.rho_s, self.alpha = props["albedo"], props["rho_s"], props["alpha"]
        lobe = (
            mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
        )
        self.m_components = [lobe]
        self.m_flags = lobe

    def sample(self, ctx, si, sample1, sample2, active=True):
        """A direction, its density, and value over density."""
        alpha = self.alpha.eval_1(si, active)
        c = dr.power(sample2.x, 1 / (alpha + 1))
        s, phi = dr.safe_sqrt(1 - c * c), 2 * dr.pi * sample2.y
        lobe = mi.Frame3f(mi.Normal3f(mi.reflect(si.wi)))
        around = lobe.to_world(mi.Vector3f(s * dr.cos(phi), s * dr.sin(phi), c))
        cosine = mi.warp.square_to_cosine_hemisphere(sample2)
        bs = dr.zeros(mi.BSDFSample3f)
        bs.wo = dr.select(sample1 < 0.5, around, cosine)
        bs.pdf = self.pdf(ctx, si, bs.wo, active)
        bs.eta = 1.0
        bs.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
        bs.sampled_component = mi.UInt32(0)
        valid = active & (bs.pdf > 0)
        value = self.eval(ctx, si, bs.wo, valid)
        return bs, dr.select(valid, value / bs.pdf, 0)

    def eval(self, ctx, si, wo, active=True):
        """Reflectance times the cosine towards the light."""
        front = active & (si.wi.z > 0) & (wo.z > 0)
        alpha, rho_s = self.alpha.eval_1(si, front), self.rho_s.eval_1(si, front)
        towards = dr.maximum(dr.dot(wo, mi.reflect(si.wi)), 0)
        lobe = rho_s * dr.power(towards, alpha)
        value = (self.albedo.eval(si, front) * wo.z + lobe) * dr.inv_pi
        return dr.select(front, value, 0)

    def pdf(self, ctx, si, wo, active=True):
        """Density of `sample`."""
        front = active & (si.wi.z > 0) & (wo.z > 0)
        alpha = self.alpha.eval_1(si, front)
        towards = dr.maximum(dr.dot(wo, mi.reflect(si.wi)), 0)
        lobe = (alpha + 1) / (2 * dr.pi) * dr.power(towards, alpha)
        return dr.select(front, 0.5 * (lobe + wo.z * dr.inv_pi), 0)

    def eval_pdf(self, ctx, si, wo, active=True):
        """Both at once, for multiple importance sampling."""
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def to_string(self) -> str:
        return "svbrdf_phong[]"


mi.register_bsdf("svbrdf_phong", Phong)
