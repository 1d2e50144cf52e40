"""The wrong answers that are known by name, each as a change of the worked answer."""

from __future__ import annotations

from drills.exercise import slips

_SET_CONST = "        mujoco.mj_setConst(model, self._scratch)\n"
_FORWARD = "        mujoco.mj_forward(model, data)\n"
_COPY = "action = np.array(action, dtype=float)"

SLIPS = slips(
    inertia_not_scaled=(
        'model.body_inertia[:] = factor[:, None] * default["body_inertia"]',
        'model.body_inertia[:] = default["body_inertia"]',
        "You changed body_mass and left body_inertia. No function of MuJoCo derives one from the "
        "other, mj_setConst neither: the body weighs more and turns as easily as before.",
    ),
    constants_not_recomputed=(
        _SET_CONST,
        "",
        "Masses and inertias are new, but the constants that MuJoCo derived from the old ones "
        "are still there. Contacts and limits are then too soft or too stiff; call mj_setConst "
        "after the change.",
    ),
    compounding=(
        'factor * default["body_mass"]',
        "factor * model.body_mass",
        'factor[:, None] * default["body_inertia"]',
        "factor[:, None] * model.body_inertia",
        'default["dof_damping"] + added',
        "model.dof_damping + added",
        "You draw from the model as it is instead of from its defaults, so that every episode "
        "multiplies and adds to the one before. After some hundred episodes nothing is left of "
        "the robot.",
    ),
    defaults_are_views=(
        "name: value.copy() for name",
        "name: value for name",
        "What you kept as defaults are views: an attribute of the model is its memory, not a "
        "copy. They change with every draw, so draws compound and restore does nothing. Keep "
        "`.copy()`.",
    ),
    not_restored=(
        "            self._arrays[name][...] = value\n",
        "            pass\n",
        "After restore the model still has the last draw's masses or dampings.",
    ),
    restored_by_recomputing=(
        "            self._arrays[name][...] = value\n",
        "            if not name.endswith(('0', 'subtreemass')):\n"
        "                self._arrays[name][...] = value\n"
        "        mujoco.mj_setConst(self.model, self._scratch)\n",
        "You put back what you had drawn and let mj_setConst compute the rest. That is not the "
        "model as it was: constants that the compiler or somebody by hand had set otherwise are "
        "lost. Keep a copy of every array and put that back.",
    ),
    zero_damping_stays=(
        'default["dof_damping"] + added[model.dof_jntid]',
        'default["dof_damping"] * (1.0 + added[model.dof_jntid])',
        "You multiply the default damping. Most joints have none by default, and a factor leaves "
        "a zero where it is: they are never randomised. Add a draw instead.",
    ),
    no_joint_damped=(
        "np.isin(model.jnt_type, single)",
        "np.array([kind in single for kind in model.jnt_type])",
        "No joint got any damping. Does your test find the hinges and slides? A number of "
        "model.jnt_type is not equal to a member of mujoco.mjtJoint when it stands on its left, "
        "as in `in`: compare with int(mujoco.mjtJoint.mjJNT_HINGE).",
    ),
    free_joints_damped=(
        "np.where(self._damped, rng.uniform(*self.damping, size=model.njnt), 0.0)",
        "rng.uniform(*self.damping, size=model.njnt)",
        "You added damping to every degree of freedom, those of free and ball joints included. A "
        "free body then falls as through honey; look up the joint of each dof in dof_jntid.",
    ),
    one_geom_only=(
        "model.geom_friction[:, 0] = friction",
        "model.geom_friction[1:, 0] = friction",
        "You changed the friction of some geoms only. MuJoCo takes the larger coefficient of the "
        "two, so a low draw disappears behind the other geom's default. Give all geoms the draw.",
    ),
    each_geom_by_itself=(
        "friction = rng.uniform(*self.friction)\n",
        "friction = rng.uniform(*self.friction, size=model.ngeom)\n",
        "model.pair_friction[:, :2] = friction ",
        "model.pair_friction[:, :2] = friction[0] ",
        "You drew a coefficient for each geom. MuJoCo takes the larger of the two, so that the "
        "contact has the distribution of the larger of two draws: slippery is rare. One draw for "
        "all geoms has the distribution that was asked for.",
    ),
    pair_forgotten=(
        "        model.pair_friction[:, :2] = friction  # of a <pair>; both directions "
        "of sliding\n",
        "",
        "The geoms have the draw, but an explicit contact pair has coefficients of its own, "
        "which win over the geoms'. Set pair_friction as well.",
    ),
    reference_pose=(
        "mj_setConst(model, self._scratch)",
        "mj_setConst(model, data)",
        "You gave mj_setConst the caller's data. It computes its constants there, and leaves the "
        "positions in the reference pose of the springs: the robot jumps. Give it an MjData of "
        "its own.",
    ),
    data_not_refreshed=(
        _FORWARD,
        "",
        "The model is new and what stands in the data is still of the old one, until somebody "
        "steps. An observation taken now mixes the two. Call mj_forward at the end.",
    ),
    one_factor_for_all=(
        "factor = rng.uniform(*self.mass, size=model.nbody)",
        "factor = np.full(model.nbody, rng.uniform(*self.mass))",
        "All bodies got the same factor. The whole robot gets heavier or lighter, but never a "
        "light arm with a heavy hand; draw one for each body.",
    ),
    one_damping_for_all=(
        "rng.uniform(*self.damping, size=model.njnt), 0.0)",
        "rng.uniform(*self.damping), 0.0)",
        "All joints got the same draw of damping; draw one for each joint.",
    ),
    end_excluded=(
        ", endpoint=True",
        "",
        "The longest delay is never drawn: `Generator.integers` leaves out the high end unless "
        "it is told `endpoint=True`.",
    ),
    one_call_off=(
        "len(self._waiting) <= self.steps",
        "len(self._waiting) < self.steps",
        "Every action comes one call early or late. With a delay of k the first k calls return "
        "`idle`, and call k + 1 returns the first action; a delay of 0 returns the action "
        "itself.",
    ),
    newest_returned=(
        "self._waiting.popleft()",
        "self._waiting.pop()",
        "What you return is the newest action, not the oldest: after the first calls there is no "
        "delay at all.",
    ),
    old_actions_kept=(
        "        self._waiting.clear()\n",
        "",
        "Actions of the episode before are still under way when the next one begins. Empty the "
        "queue in randomize.",
    ),
    action_not_copied=(
        _COPY,
        "action = np.asarray(action, dtype=float)",
        "You keep the caller's array itself. When it is written again, all waiting actions "
        "change with it, and the delay is gone. Keep a copy.",
    ),
    idle_cut_off=(
        "np.full(action.shape, self.idle, dtype=float)",
        "np.full(action.shape, self.idle, dtype=int)",
        "Until the first action is due, `idle` comes back without the digits behind its point: an "
        "array of integers takes no fractions. Write dtype=float.",
    ),
    noise_uniform=(
        "rng.normal(0.0, self.noise, size=observation.shape)",
        "rng.uniform(-self.noise, self.noise, size=observation.shape)",
        "The noise is uniform between plus and minus `noise`. The task asks for normal noise with "
        "this standard deviation.",
    ),
    noise_in_place=(
        "return observation + rng.normal(0.0, self.noise, size=observation.shape)",
        "observation += rng.normal(0.0, self.noise, size=observation.shape)\n"
        "        return observation",
        "You add the noise to the caller's array. The true state is then noisy as well, and more "
        "so in every call. Return a new array.",
    ),
    same_noise=(
        "rng.normal(0.0, self.noise",
        "np.random.default_rng(0).normal(0.0, self.noise",
        "The noise is the same in every call: a constant offset, which a policy learns away. "
        "Draw from the generator that is handed in, each time.",
    ),
    one_noise_for_all=(
        ", size=observation.shape)",
        ")",
        "All components get the same number. Draw an array of the observation's shape.",
    ),
    variance_for_deviation=(
        "rng.normal(0.0, self.noise,",
        "rng.normal(0.0, self.noise**2,",
        "You took the noise for a variance, or squared it: `normal` wants the standard deviation.",
    ),
)
