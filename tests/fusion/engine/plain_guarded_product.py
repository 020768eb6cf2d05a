"""The weights of guarded_product, formula by formula: the plain form that the fast one is compared with."""

import numpy as np

from common.probability import SMALLEST
from fusion.engine.guarded_product import (
    BETA,
    CERTAIN_MASS,
    EPSILON,
    GAMMA,
    LEAST_SIZE,
    NATS_TO_BITS,
    ODDS_OF_FAULT,
    PARTICIPATION_BITS,
    SIMILARITY_SCALE,
    believed_by,
)
from fusion.engine.trust import odds_of_fault
from fusion.engine.weighing import PoolingWeights

EXPONENT_LIMIT = 500.0
"""Nats; far beyond the log Bayes factor of some tens of observers. It keeps the exponential finite."""


def plain_weights(p, prior, trust=None):
    """(..., N, M) posteriors, (M,) prior -> exponents (..., H, N) and probabilities of H hypotheses: N + 1, or 1."""
    ratio, trust = p * (1.0 / prior), np.ones(p.shape[:-1]) if trust is None else trust
    divergence_bits = divergence_from_prior(p, ratio)
    participation = np.minimum(divergence_bits / PARTICIPATION_BITS, 1.0)
    believed = believed_by(p.shape[-2])
    # Row j, column i: the correlation by which observer i loses weight to observer j.
    rho = np.where(np.eye(p.shape[-2], dtype=bool), similarity(ratio), similarity(ratio) * uncertainty(p))
    w = believed * trust[..., None, :] / np.maximum(believed @ rho, 1.0)
    hypotheses = _hypotheses(w, ratio, prior, participation * odds_of_fault(trust), participation.sum(axis=-1))
    exponents = w * np.maximum(_effective_number(w, divergence_bits), 1.0)[..., None] ** (GAMMA - 1.0)
    mean_exponents = (hypotheses[..., None, :] @ exponents)[..., 0, :]
    return PoolingWeights(
        exponents, np.full(p.shape[:-1], EPSILON), shares_of(mean_exponents * divergence_bits), hypotheses
    )


def uncertainty(p):
    """(..., N, N), 0 to 1: 0 for two that are certain of the same label, 1 for others."""
    top = (p[..., :, None, :] + p[..., None, :, :]).max(axis=-1)
    return np.minimum((1.0 - top / 2) / CERTAIN_MASS, 1.0)


def similarity(ratio):
    """(..., N, N): 1 for equal posteriors, near 0 for independent ones, and for two at the prior."""
    logs = np.log((1.0 - EPSILON) * ratio + EPSILON)
    sizes = np.abs(logs).sum(axis=-1) + LEAST_SIZE
    both = sizes[..., :, None] + sizes[..., None, :]
    distance = (np.abs(logs[..., :, None, :] - logs[..., None, :, :]).sum(axis=-1) + LEAST_SIZE) / (both / 2)
    return np.exp(-distance / SIMILARITY_SCALE)


def _effective_number(w, divergence_bits):
    """W of each hypothesis (3), (..., H); 1 if no observer participates. w (..., H, N)."""
    information = w * divergence_bits[..., None, :]
    squares = (information @ divergence_bits[..., None])[..., 0]
    return (information.sum(axis=-1) ** 2 + PARTICIPATION_BITS**2) / (squares + PARTICIPATION_BITS**2)


def _hypotheses(w, ratio, prior, doubted, participants):
    """P(h) of each hypothesis (1), (..., H). ratio: p/prior. doubted (..., N): participation, times odds of a fault."""
    if w.shape[-2] == 1:
        return np.ones((*participants.shape, 1))
    log_likelihood = w @ np.log((1.0 - EPSILON) * ratio + EPSILON)
    largest = np.maximum.reduce(log_likelihood, axis=-1)
    log_z = np.log(np.exp(log_likelihood - largest[..., None]) @ prior) + largest
    of_three, of_four = ODDS_OF_FAULT
    odds = of_three * np.minimum(np.maximum(participants - 2.0, 0.0), 1.0)
    odds = odds + (of_four - of_three) * np.minimum(np.maximum(participants - 3.0, 0.0), 1.0)
    mass = np.exp(np.minimum(BETA * (log_z - log_z[..., :1]), EXPONENT_LIMIT))
    mass[..., 1:] *= odds[..., None] * doubted
    return mass / mass.sum(axis=-1, keepdims=True)


def divergence_from_prior(p, ratio):
    """(..., N, M) posteriors, their ratios to the prior -> (..., N) sum p log2(p~/prior), 0 or more."""
    # As guarded_product.py computes it, to the last bit: shares of almost nothing depend on it.
    logs = np.log((1.0 - EPSILON) * ratio + EPSILON)
    return np.maximum(p * logs @ np.full(p.shape[-1], NATS_TO_BITS), 0.0)


def shares_of(amounts):
    """(..., N) amounts, at least 0 -> their shares of the sum along the last axis; equal shares of 0."""
    total = amounts.sum(axis=-1, keepdims=True)
    return np.where(total > 0, amounts / np.maximum(total, SMALLEST), 1.0 / amounts.shape[-1])
