"""What a kind of study gives the methods: scenarios, and what comes of them."""
