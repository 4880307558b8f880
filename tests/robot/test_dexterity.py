"""What the Jacobian says of postures."""

import numpy as np

from workbench.robot import Chain, dexterity, forward_kinematics


def test_postures_that_are_unknown_or_singular_change_no_others(chain: Chain) -> None:
    q = np.array([[0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [np.nan] * 6, [0.1, 0.2, 0.3, 0.4, 0.0, 0.6]])
    tip = forward_kinematics(chain, q)[:, :3, 3]
    _, condition, asked = dexterity(chain, q, tip, np.ones(6))
    _, alone, asked_alone = dexterity(chain, q[:1], tip[:1], np.ones(6))
    assert np.allclose(condition[:1], alone, rtol=1e-12)
    assert np.allclose(asked[:1], asked_alone, rtol=1e-12)
    assert condition[1] == np.inf
    assert condition[2] > 1e12
    assert np.isinf(asked[1:]).all()
